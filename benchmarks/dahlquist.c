/*
 * The peer of the device FMU: dx/dt = -k x by one Euler step in each doStep, FMI 2.0, co-simulation. It has the structure
 * of the Reference FMU Dahlquist, and is our own: no more functions than the benchmark calls.
 */
#include <stdlib.h>
#include "fmi2Functions.h"

typedef struct {
    double time, x, k;
} Model;

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean is_talkative)
{
    Model *m = calloc(1, sizeof *m);
    (void)name, (void)type, (void)token, (void)resources, (void)host, (void)visible, (void)is_talkative;
    if (m)
        m->x = m->k = 1.0;
    return m;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

/* 0: x, 1: k, which stands for an input. */
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[])
{
    const Model *m = c;
    size_t j;
    for (j = 0; j < n; j++) {
        if (r[j] > 1)
            return fmi2Error;
        v[j] = r[j] ? m->k : m->x;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[])
{
    Model *m = c;
    size_t j;
    for (j = 0; j < n; j++) {
        if (r[j] != 1)
            return fmi2Error;
        m->k = v[j];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real duration, fmi2Boolean is_final)
{
    Model *m = c;
    (void)is_final;
    m->x += duration * (-m->k * m->x);
    m->time = time + duration;
    return fmi2OK;
}
