/*
 * Counter-based random numbers: the same key and counters give the same numbers, in whatever order they are asked for.
 */
#ifndef RANDOM
#define RANDOM
#include <stdint.h>
#define PI 3.141592653589793

/* Philox4x32-10 (Salmon et al., SC 2011), counter (counter0, counter1, 0, 0), as numbers in (0, 1). */
static void draw(uint32_t k0, uint32_t k1, uint32_t counter0, uint32_t counter1, double *numbers)
{
    uint32_t c[4] = {counter0, counter1, 0, 0};
    int k;
    for (k = 0; k < 10; k++) {
        const uint64_t p0 = (uint64_t)0xD2511F53u * c[0], p1 = (uint64_t)0xCD9E8D57u * c[2];
        const uint32_t c1 = c[1], c3 = c[3];
        c[0] = (uint32_t)(p1 >> 32) ^ c1 ^ k0;
        c[1] = (uint32_t)p1;
        c[2] = (uint32_t)(p0 >> 32) ^ c3 ^ k1;
        c[3] = (uint32_t)p0;
        k0 += 0x9E3779B9u;
        k1 += 0xBB67AE85u;
    }
    for (k = 0; k < 4; k++)
        numbers[k] = ((double)c[k] + 0.5) * 2.3283064365386963e-10;
}
#endif
