# The bare-metal images: they must build, and the tests across parts run them in QEMU. (The
# Cortex-M7 image holds only the core, which the STM32F405 image holds as well: only the full run builds it.)
build_preset stm32f405
build_preset r5f
[ $LEVEL != full ] || build_preset cortex-m7
