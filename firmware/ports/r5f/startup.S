// Exception vectors and reset of the Cortex-R5F in the Zynq UltraScale+ (Arm DDI 0406, B1.8 and B1.9; AMD UG1085, chapter 4).
// Everything runs in Supervisor mode; interrupts save their state on its stack.

  .syntax unified
  .arm

  .equ MODE_SVC, 0x13
  .equ SCTLR_V, 1 << 13          // vectors at 0xFFFF0000
  .equ CPSR_IRQ_FIQ_OFF, 0xC0

  .section .vectors, "ax"
  .global _vectors
_vectors:
  ldr pc, =reset_handler
  ldr pc, =unexpected            // undefined instruction: floating point is one, its unit is off
  ldr pc, =unexpected            // supervisor call
  ldr pc, =unexpected            // prefetch abort
  ldr pc, =unexpected            // data abort
  ldr pc, =unexpected            // reserved
  ldr pc, =irq_entry
  ldr pc, =unexpected            // fast interrupt
  .ltorg

  .section .text.startup, "ax"
  .global reset_handler
  .type reset_handler, %function
reset_handler:
  msr cpsr_c, #(MODE_SVC | CPSR_IRQ_FIQ_OFF)
  ldr sp, =_estack
  mrc p15, 0, r0, c1, c0, 0
  bic r0, r0, #SCTLR_V
  mcr p15, 0, r0, c1, c0, 0
  isb

  ldr r0, =early_start           // the watchdog, before anything can hang; uses no memory but the stack
  blx r0

  ldr r0, =_sidata
  ldr r1, =_sdata
  ldr r2, =_edata
1:
  cmp r1, r2
  ldrlo r3, [r0], #4
  strlo r3, [r1], #4
  blo 1b

  ldr r1, =_sbss
  ldr r2, =_ebss
  mov r3, #0
2:
  cmp r1, r2
  strlo r3, [r1], #4
  blo 2b

  ldr r4, =__init_array_start
  ldr r5, =__init_array_end
3:
  cmp r4, r5
  bhs 4f
  ldr r0, [r4], #4
  blx r0
  b 3b
4:
  ldr r0, =main
  blx r0
  b unexpected

  .type irq_entry, %function
irq_entry:
  sub lr, lr, #4
  srsdb sp!, #MODE_SVC
  cps #MODE_SVC
  push {r0-r3, r12, lr}
  and r1, sp, #4                 // the procedure call standard wants eight bytes
  sub sp, sp, r1
  push {r1, r2}
  ldr r0, =irq_handler
  blx r0
  pop {r1, r2}
  add sp, sp, r1
  pop {r0-r3, r12, lr}
  rfeia sp!

  .type unexpected, %function
unexpected:
  msr cpsr_c, #(MODE_SVC | CPSR_IRQ_FIQ_OFF)
  ldr sp, =_estack
  ldr r0, =fault_handler
  bx r0
