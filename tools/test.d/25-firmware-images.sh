# Builds the bare-metal images, which the tests across parts run in QEMU. Only the full run builds the Cortex-M7 image:
# it contains only the core, which the STM32F405 image contains as well.
build_preset stm32f405
build_preset r5f
[ $LEVEL != full ] || build_preset cortex-m7
