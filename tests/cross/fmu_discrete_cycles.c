/* 2000 lives (LIVES) of a discrete FMU in one process, three at a time, for the sanitizers; then all weights of the lattices. */
#include "fmu.c"
#ifndef LIVES
#define LIVES 2000
#endif

#if FMI_VERSION == 2
static void quiet(void *c, const char *i, fmi2Status s, const char *k, const char *t, ...) { (void)c, (void)i, (void)s, (void)k, (void)t; }
static fmi2CallbackFunctions host = {quiet, NULL, NULL, NULL, NULL};
#else
static void quiet(void *c, fmi3Status s, const char *k, const char *t) { (void)c, (void)s, (void)k, (void)t; }
#endif

int main(void)
{
    const unsigned int x = FIRST_Y + 6, st = FIRST_Y + 10, key = FIRST_P;
    const double bad = NAN;
    double out, last = 0.0;
    int life, k, charge = 0, now = 0, moves = 0, seven = 7;
    for (life = 0; life < LIVES; life++) {
        Instance *m[3];
        void *state = NULL;
        char bytes[sizeof(Snapshot)];
        for (k = 0; k < 3; k++) {
#if FMI_VERSION == 2
            m[k] = fmi2Instantiate("life", fmi2CoSimulation, MODEL_TOKEN, "", &host, 0, 1);
            fmi2SetupExperiment(m[k], 0, 0.0, 0.0, 0, 0.0);
            fmi2EnterInitializationMode(m[k]);
#else
            m[k] = fmi3InstantiateCoSimulation("life", MODEL_TOKEN, "", 0, 1, 0, 0, NULL, 0, NULL, quiet, NULL);
            fmi3EnterInitializationMode(m[k], 0, 0.0, 0.0, 0, 0.0);
#endif
            if (set_integers(m[k], &key, 1, &seven) || leave_initialization(m[k]) || step(m[k], 0.0, (k + 1) * TIMESTEP))
                return 1;
            if (!set_values(m[k], &x, 1, &bad) || !step(m[k], 0.0, 0.5 * TIMESTEP) || m[k]->s.phase != FAILED)
                return 2;
            m[k]->s.phase = STEPPING;
        }
        if (save_state(m[0], &state) || write_state(m[0], state, bytes, sizeof bytes) || load_state(m[1], state))
            return 3;
        free(state);
        bytes[20] ^= 1;
        if (!read_state(m[2], bytes, sizeof bytes, &state) || !read_state(m[2], bytes, 5, &state))
            return 4;
        bytes[20] ^= 1;
        if (read_state(m[2], bytes, sizeof bytes, &state) || load_state(m[2], state))
            return 5;
        free(state);
        if (step(m[2], 0.0, TIMESTEP) || get_integers(m[2], &st, 1, &now) || now != 2 || get_values(m[2], &x, 1, &out))
            return 6;
        moves += out != last;
        last = out;
        for (k = 0; k < 3; k++)
            destroy(m[k]);
    }
    if (create(calloc(1, sizeof(Instance)), "other", "no token of this model", 1, 0))
        return 7;
#if !defined(IS_DIE)
    for (k = HP; k <= LINEAR; k++)
        for (charge = 0; charge <= charge_top[k]; charge += charge_event[k])
            printf("%d %d %.17g\n", k, charge, weight_at(k, charge));
#endif
    (void)charge;
    return moves == 1 ? 0 : 8; /* every life came to the same place */
}
