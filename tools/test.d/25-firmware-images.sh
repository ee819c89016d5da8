# The bare-metal images: they must build, and the tests across parts run them in QEMU. (The Cortex-M7 has the core alone, which
# the Cortex-M4 runs too.)
build_preset stm32f405
build_preset r5f
[ $LEVEL != full ] || build_preset cortex-m7
