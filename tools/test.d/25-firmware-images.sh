# The bare-metal images: they must build, and the tests across parts run them in QEMU.
for preset in stm32f405 cortex-m7 r5f; do build_preset "$preset"; done
