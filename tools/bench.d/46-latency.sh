# How late SYNC and targets leave the STM32F405's node, of the commit before frames were held for SYNC and of this one.
LATENCY_BEFORE=fa825b8
before=build/before-$LATENCY_BEFORE
if [ ! -e "$before/build/stm32f405/images/latency_check.elf" ]; then
  rm -rf "$before"
  mkdir -p "$before/.cache"
  git archive "$LATENCY_BEFORE" | tar x -C "$before"
  cp -r .cache/sdist "$before/.cache/"
  mkdir -p "$before/firmware/ports/stm32f405/checks"
  cp firmware/ports/stm32f405/checks/latency_check.cc "$before/firmware/ports/stm32f405/checks/"
  sed -n '/armtrue_arm_image(latency_check/,+2p' firmware/ports/stm32f405/CMakeLists.txt >"$before/image.cmake"
  sed -i "/armtrue_arm_image(boot_check/r $before/image.cmake" "$before/firmware/ports/stm32f405/CMakeLists.txt"
  # Headers lay in one folder then; of the images only this one is built.
  sed -i 's#firmware/canopen/protocol/#firmware/canopen/#; s#firmware/core/[a-z]*/#firmware/core/#' \
    "$before/firmware/ports/stm32f405/checks/latency_check.cc"
  (cd "$before" && cmake --preset stm32f405 >/dev/null && cmake --build --preset stm32f405 -j "$JOBS" --target latency_check >/dev/null)
fi
$PY tools/into_results.py latency $PY tests/firmware/latency_report.py --before "$before/build/stm32f405/images/latency_check.elf"
