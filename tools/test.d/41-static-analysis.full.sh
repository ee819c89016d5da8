# cppcheck with its MISRA addon, and clang-tidy, on the code that devices run. Findings fail, except those listed in
# firmware/cppcheck-deviations.txt. (clang-tidy uses the compile commands of step 36.)
shipped_sources() {
  ls firmware/core/*.cc firmware/core/*/*.cc firmware/storage/*.cc firmware/canopen/*/*.cc firmware/canopen/*/*/*.cc firmware/ports/common/*.cc \
    firmware/ports/stm32f405/*.cc firmware/ports/arm/*.cc firmware/ports/posix/*.cc |
    grep -vE '_test\.cc|/soak|/senseless|_main\.cc|/transfer_sizes|/semihosting|/conformance'
}
mkdir -p out
configure sanitize
deviations=firmware/cppcheck-deviations.txt
shipped_sources | grep -vE 'ports/(posix|arm|stm32f405)' >out/shipped.txt
found=$(cppcheck -j "$JOBS" --addon=misra --std=c++20 --language=c++ --inline-suppr --quiet -I. -D__arm__ \
  --enable=warning,style,performance,portability --suppressions-list="$deviations" --file-list=out/shipped.txt \
  --template='{file}:{line}: {id}: {message}' 2>&1)
[ -z "$found" ] || { echo "$found"; false; }
# Checks that the MISRA addon works: it must report the goto in this file.
printf 'int f(int x);\nint f(int x) { if (x == 0) { goto end; } x = 2; end: return x; }\n' >out/not_misra.cc
seen=$(cppcheck --addon=misra --language=c++ --quiet out/not_misra.cc --suppressions-list="$deviations" --template='{id}' 2>&1)
[[ $seen == *misra-c2012-15.1* ]]
grep -E '^firmware/(core|storage|canopen|ports/common)' out/shipped.txt |
  xargs -P "$JOBS" -n 6 clang-tidy-14 -p build/sanitize --quiet --extra-arg=-Wno-unknown-warning-option 2>/dev/null
echo "cppcheck (MISRA) and clang-tidy: nothing beyond firmware/cppcheck-deviations.txt"
