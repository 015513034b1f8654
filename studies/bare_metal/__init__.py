"""Generated code on a microcontroller without one: compiled for a Cortex-M, run in QEMU, its instructions counted."""
