/*
 * A die as a controller: 21 steps of the network in a timestep, every synapse a device that follows its own law. model.c,
 * which includes this, holds the die: its cells, sorted by receiver, then sender, what the waveform asks of them, and
 * its neurons. Without wires every device sees the voltage of its lines; an event is a charge, in thousandths of the
 * device's, so its state is an origin and a count of events since, which a wall takes over.
 */
enum { INPUTS = 6, STEPS = 21 };
enum { C, C_INI, GAIN, HIGH_COUNT }; /* parameters, in this order */

typedef struct {
    double y[NEURONS];               /* membrane potentials */
    double origin[CELLS], count[CELLS], s[CELLS];
    double weight[CELLS];            /* as read, with polarity and gain */
    long long clock;                 /* steps done */
    int ls[NEURONS];                 /* set by a spike, counts down */
    int spiked[NEURONS];             /* spikes in this timestep */
    int action;
    signed char ring[SLOTS][NEURONS]; /* spikes by step: shift registers of the rows */
} Controller;

static void read_cell(Controller *m, int k)
{
    const int t = cell_tile[k];
    const double g = cell_is_live[k] ? conductance(t, m->s[k]) : cell_fixed[k];
    m->weight[k] = cell_polarity[k] * tile_gain[t] * ((g - tile_reference[t]) / (tile_on[t] - tile_reference[t]));
}

/* What a timestep begins with where nothing is carried over. */
static void controller_rest(const double *p, Controller *m)
{
    int j;
    memset(m->ls, 0, sizeof m->ls);
    memset(m->ring, 0, sizeof m->ring);
    m->clock = 0;
    for (j = 0; j < NEURONS; j++)
        m->y[j] = p[C_INI];
}

static void controller_start(const double *p, Controller *m)
{
    int k;
    memset(m, 0, sizeof *m);
    controller_rest(p, m);
    for (k = 0; k < first_cell[NEURONS]; k++) {
        m->s[k] = m->origin[k] = cell_start[k];
        read_cell(m, k);
    }
}

/* A number of events on one device. */
static void move_charge(Controller *m, int k, double events)
{
    const double x = m->origin[k] + (m->count[k] + events) / 1000.0;
    m->count[k] += events;
    if (x <= 0.0 || x >= 1.0) {
        m->origin[k] = x <= 0.0 ? 0.0 : 1.0;
        m->count[k] = 0.0;
    }
    m->s[k] = x <= 0.0 ? 0.0 : x >= 1.0 ? 1.0 : x;
    read_cell(m, k);
}

/* The phases of the waveform on the rows and columns of all cells. */
static void program(Controller *m)
{
    int j, k, phase;
    for (j = INPUTS; j < NEURONS; j++) {
        const int post = m->ls[j];
        for (k = first_cell[j]; post && k < first_cell[j + 1]; k++) {
            const int pre = m->ls[cell_sender[k]];
            if (!cell_is_live[k] || !may_fire[pre][post])
                continue;
            for (phase = 0; phase < PHASES; phase++) {
                const double level = column_level[phase][post] - row_level[phase][pre];
                const double sign = level > 0.0 ? 1.0 : -1.0;
                if (level != 0.0 && fabs(level) / EVENT_LEVEL * PULSE_VOLTAGE > cell_threshold[k])
                    move_charge(m, k, sign * (cell_factor[k] * (1.0 + sign * ASYMMETRY) * phase_width[phase]));
            }
        }
    }
}

static void controller_tick(const double *p, const double *sensors, Controller *m)
{
    int j, k;
    for (j = 0; j < NEURONS; j++) {
        double current, y;
        if (j < INPUTS) {
            current = sensors[j];
        } else {
            double total = 0.0;
            for (k = first_cell[j]; k < first_cell[j + 1]; k++) {
                const long long sent = m->clock - cell_tap[k];
                if (sent >= 0 && m->ring[sent % SLOTS][cell_sender[k]])
                    total += m->weight[k];
            }
            current = p[GAIN] * (total + neuron_offset[j]);
        }
        y = m->y[j] + (current + neuron_a[j] - neuron_b[j] * m->y[j]);
        if (CLAMP && y < 0.0)
            y = 0.0;
        m->ring[m->clock % SLOTS][j] = y > neuron_threshold[j];
        if (y > neuron_threshold[j]) {
            y = p[C];
            m->ls[j] = LAST_SPIKE;
            m->spiked[j]++;
        }
        m->y[j] = y;
    }
    program(m);
    for (j = 0; j < NEURONS; j++)
        m->ls[j] -= m->ls[j] > 0;
    m->clock++;
}

/* A timestep; the action follows from the outputs' spike counts: 0 forward, 1 left, 2 right. */
static void controller_step(const double *p, const double *sensors, Controller *m)
{
    int k, left, right;
    if (!CARRY_STATE)
        controller_rest(p, m);
    memset(m->spiked, 0, sizeof m->spiked);
    for (k = 0; k < STEPS; k++)
        controller_tick(p, sensors, m);
    left = m->spiked[NEURONS - 2] >= p[HIGH_COUNT];
    right = m->spiked[NEURONS - 1] >= p[HIGH_COUNT];
    m->action = left == right ? 0 : left ? 1 : 2;
}
