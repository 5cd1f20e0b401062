/* Instruction sets that this processor has, and whose registers its system saves. */
#include "entry_points.h"

#include <string.h>

#if defined(__x86_64__)

#include <cpuid.h>

#define HAS(word, bit) (((word) >> (bit)) & 1u)

static uint64_t saved_registers(void)
{
    uint32_t low, high;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return ((uint64_t)high << 32) | low;
}

int has_instructions(const char *name)
{
    unsigned a, b, d, basic, wide, unused, extended;
    if (!__get_cpuid(1, &a, &b, &basic, &d) || !__get_cpuid_count(7, 0, &a, &wide, &unused, &d) ||
        !__get_cpuid(0x80000001u, &a, &b, &extended, &d)) {
        return 0;
    }
    /* FMA, MOVBE, OSXSAVE, AVX, F16C; BMI1, AVX2, BMI2; LZCNT; and the system saves XMM and YMM. */
    int is_v3 = HAS(basic, 12) && HAS(basic, 22) && HAS(basic, 27) && HAS(basic, 28) && HAS(basic, 29) &&
                HAS(wide, 3) && HAS(wide, 5) && HAS(wide, 8) && HAS(extended, 5) &&
                (saved_registers() & 0x6) == 0x6;
    if (strcmp(name, "v3") == 0) {
        return is_v3;
    }
    /* AVX-512 F, DQ, CD, BW, VL; and the system saves masks and ZMM. */
    return strcmp(name, "v4") == 0 && is_v3 && HAS(wide, 16) && HAS(wide, 17) && HAS(wide, 28) &&
           HAS(wide, 30) && HAS(wide, 31) && (saved_registers() & 0xe6) == 0xe6;
}

#elif defined(__wasm__)

int has_instructions(const char *name)
{
    return name[0] != '\0'; /* a module has one set, and does not load without it */
}

#else

int has_instructions(const char *name)
{
    return strcmp(name, "neon") == 0;
}

#endif
