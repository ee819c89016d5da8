# The bare-metal images: they must build, and the tests across parts run them in QEMU. (The image for the
# Cortex-M7 holds only the core, which that of the STM32F405 holds too: the full run builds it.)
build_preset stm32f405
build_preset r5f
[ $LEVEL != full ] || build_preset cortex-m7
