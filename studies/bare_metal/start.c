/* Where a Cortex-M begins in the emulator: stack and entry, the floating-point unit switched on.
 *
 * The C library writes and ends through the emulator's semihosting (--specs=rdimon.specs). */
#include <stdint.h>

extern uint32_t stack_top[];
extern void _start(void);

void reset(void);

void reset(void)
{
#if defined(__ARM_FP)
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: full access to CP10 and CP11 */
    __asm volatile("dsb\n\tisb" ::: "memory");
#endif
    _start();
}

/* A fault ends the run with status 3: SYS_EXIT_EXTENDED. */
static void fault(void)
{
    static const uint32_t why[2] = {0x20026u, 3u};
    register uint32_t operation __asm("r0") = 0x20u;
    register const uint32_t *block __asm("r1") = why;

    __asm volatile("bkpt 0xAB" : : "r"(operation), "r"(block) : "memory");
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))stack_top, reset, fault, fault, fault, fault, fault,
};
