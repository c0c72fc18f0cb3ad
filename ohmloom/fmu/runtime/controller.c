/*
 * A spiking controller after Howard et al. (2012), Sections IV and V: 21 steps of the network in a timestep. model.c,
 * which includes this, holds the network: its sizes, its synapses sorted by receiver, then sender, and its readings.
 */
enum { INPUTS = 6, STEPS = 21 };
enum { A, B, C, C_INI, Y_THRESH, GAIN, HIGH_COUNT }; /* parameters, in this order */
enum { HP, PEO_PANI, LINEAR, CONSTANT };             /* kinds of synapse */

typedef struct {
    double y[NEURONS];                    /* membrane potentials */
    double weight[SYNAPSES];              /* with the sender's sign */
    double emitted[EMITTED][SYNAPSES];    /* weights at emission, by step */
    long long clock;                      /* steps done */
    int charge[SYNAPSES];                 /* of plastic synapses, in their lattice's units */
    int ls[NEURONS];                      /* set by a spike, counts down */
    int spiked[NEURONS];                  /* spikes in this timestep */
    int action;
    signed char ring[SLOTS][NEURONS];     /* spikes by step */
} Controller;

/* Charge lattices by kind: change by one event, and the largest charge. */
static const int charge_event[] = {99, 5049, 1}, charge_top[] = {99000, 5049000, 1000};

static double weight_at(int kind, int charge)
{
    switch (kind) {
    case HP:
        return 0.01 / (1.0 - charge / 100000.0);
    case PEO_PANI:
        return 1.01 - 0.01 / (0.01 + charge / 5100000.0);
    default:
        return charge / 1000.0;
    }
}

static void controller_rest(const double *p, Controller *s)
{
    int j;
    memset(s->ls, 0, sizeof s->ls);
    memset(s->ring, 0, sizeof s->ring);
    s->clock = 0;
    for (j = 0; j < NEURONS; j++)
        s->y[j] = p[C_INI];
}

static void controller_start(const double *p, Controller *s)
{
    int k;
    memset(s, 0, sizeof *s);
    controller_rest(p, s);
    for (k = 0; k < SYNAPSES; k++) {
        s->weight[k] = first_weight[k];
        s->charge[k] = first_charge[k];
    }
}

/* Eqs. 10 to 12: whoever spiked later moves the charge by one event; then ls counts down. */
static void learn(Controller *s)
{
    int k, j;
    for (k = 0; k < first_synapse[NEURONS]; k++) {
        const int before = s->ls[sender[k]], after = s->ls[receiver[k]], kind = synapse_kind[k];
        if (kind == CONSTANT || before + after <= STDP_THRESHOLD || before == after)
            continue;
        s->charge[k] += after > before ? charge_event[kind] : -charge_event[kind];
        s->charge[k] = s->charge[k] > charge_top[kind] ? charge_top[kind] : s->charge[k] < 0 ? 0 : s->charge[k];
        s->weight[k] = sign[sender[k]] * weight_at(kind, s->charge[k]);
    }
    for (j = 0; j < NEURONS; j++)
        s->ls[j] -= s->ls[j] > 0;
}

/* One step: spikes arrive after their delays, in ascending order of senders; eqs. 3 to 5. */
static void controller_tick(const double *p, const double *sensors, Controller *s)
{
    const int slot = (int)(s->clock % SLOTS);
    int j, k;
    for (j = 0; j < NEURONS; j++) {
        double current, y;
        if (j < INPUTS) {
            current = sensors[j] + (INPUT_BIAS ? p[A] : 0.0);
        } else {
            double total = 0.0;
            for (k = first_synapse[j]; k < first_synapse[j + 1]; k++) {
                const long long sent = s->clock - delay[k];
                if (sent >= 0 && s->ring[sent % SLOTS][sender[k]])
                    total += AT_EMISSION ? s->emitted[sent % EMITTED][k] : s->weight[k];
            }
            current = p[GAIN] * total + p[A];
        }
        y = s->y[j] + (current - p[B] * s->y[j]);
        if (CLAMP && y < 0.0)
            y = 0.0;
        s->ring[slot][j] = y > p[Y_THRESH];
        if (y > p[Y_THRESH]) {
            y = p[C];
            s->ls[j] = LAST_SPIKE;
            s->spiked[j]++;
        }
        s->y[j] = y;
    }
    if (AT_EMISSION)
        memcpy(s->emitted[s->clock % EMITTED], s->weight, sizeof s->weight);
    learn(s);
    s->clock++;
}

/* A timestep; the action follows from the outputs' spike counts, eq. 6: 0 forward, 1 left, 2 right. NULL: nothing can fail. */
static const char *controller_step(const double *p, const double *sensors, Controller *s)
{
    int k, left, right;
    if (!CARRY_STATE)
        controller_rest(p, s);
    memset(s->spiked, 0, sizeof s->spiked);
    for (k = 0; k < STEPS; k++)
        controller_tick(p, sensors, s);
    left = s->spiked[NEURONS - 2] >= p[HIGH_COUNT];
    right = s->spiked[NEURONS - 1] >= p[HIGH_COUNT];
    s->action = left == right ? 0 : left ? 1 : 2;
    return NULL;
}
