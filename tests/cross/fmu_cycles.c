/* 2000 lives of an FMU in one process, several at a time, for the sanitizers: run, save, restore, derive, free. */
#include "fmu.c"

#if FMI_VERSION == 2
static void quiet(void *c, const char *i, fmi2Status s, const char *k, const char *t, ...) { (void)c, (void)i, (void)s, (void)k, (void)t; }
static fmi2CallbackFunctions host = {quiet, NULL, NULL, NULL, NULL};
#else
static void quiet(void *c, fmi3Status s, const char *k, const char *t) { (void)c, (void)s, (void)k, (void)t; }
#endif

int main(void)
{
    const unsigned int v = FIRST_U, q = FIRST_X, rate = FIRST_DX;
    const double one = 1.0, bad = NAN;
    double out, slope, last = 0.0;
    int life, k, moves = 0;
    for (life = 0; life < 2000; life++) {
        Instance *m[3];
        void *state = NULL;
        char bytes[sizeof(Snapshot)];
        for (k = 0; k < 3; k++) {
#if FMI_VERSION == 2
            m[k] = fmi2Instantiate("life", fmi2CoSimulation, MODEL_TOKEN, "", &host, 0, 1);
            fmi2SetupExperiment(m[k], 1, 1e-6, 0.0, 0, 0.0);
            fmi2EnterInitializationMode(m[k]);
#else
            m[k] = fmi3InstantiateCoSimulation("life", MODEL_TOKEN, "", 0, 1, 0, 0, NULL, 0, NULL, quiet, NULL);
            fmi3EnterInitializationMode(m[k], 1, 1e-6, 0.0, 0, 0.0);
#endif
            leave_initialization(m[k]);
            if (set_values(m[k], &v, 1, &one) || step(m[k], 0.0, 0.2 * (k + 1)) || step(m[k], 0.2, 1.0))
                return 1;
            if (!set_values(m[k], &v, 1, &bad))
                return 2;
        }
        if (save_state(m[0], &state) || write_state(m[0], state, bytes, sizeof bytes) || load_state(m[1], state))
            return 3;
        free(state);
        if (read_state(m[2], bytes, sizeof bytes, &state) || load_state(m[2], state))
            return 4;
        free(state);
        if (differentiate(m[2], &rate, 1, &q, 1, &one, &slope, 0) || get_values(m[2], &q, 1, &out))
            return 5;
#if defined(HAS_ARRAYS)
        {
            double all[N_X];
            if (fmi3GetFloat64(m[2], &q, 1, all, N_X) || all[0] != out || !fmi3GetFloat64(m[2], &q, 1, all, N_X - 1))
                return 8;
        }
#endif
        moves += out != last;
        last = out;
        for (k = 0; k < 3; k++)
            destroy(m[k]);
    }
    if (create(calloc(1, sizeof(Instance)), "other", "no token of this model", 1, 0))
        return 6;
    return moves == 1 ? 0 : 7; /* every life came to the same charge */
}
