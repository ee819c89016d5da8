#: firmware  build the STM32F405, Cortex-M7 and Cortex-R5F images; print their code, data, stack, instructions and files
cmd_firmware() {
  install_packages run firmware
  cmd_build
  say "building the bare-metal images"
  local preset
  for preset in stm32f405 cortex-m7 r5f; do build_preset "$preset" | tail -1; done
  say "what they cost"
  $PY tests/firmware/firmware_report.py
  echo
  echo "how to flash: docs/flashing.md"
}
