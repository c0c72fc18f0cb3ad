/*
 * A die as a controller: 21 steps of the network in a timestep, every synapse a device that follows its own law. model.c,
 * which includes this, holds the die: its cells, sorted by receiver, then sender, what the waveform asks of them, and
 * its neurons. Cells are programmed one by one, or all lines at once through their wires. Columns read the cells
 * themselves, or, with wires, what is left of every row's voltage: potentials are solved for anew after each programming.
 * States decay between timesteps, and are disturbed by reads; columns are noisy and pass a converter, where the die has it.
 */
#if HAS_READ_NOISE || HAS_CYCLE_NOISE
#include "random.c"
#endif
enum { INPUTS = 6, STEPS = 21 };
enum { C, C_INI, GAIN, HIGH_COUNT }; /* parameters, in this order */

typedef struct {
    double y[NEURONS];               /* membrane potentials */
    double origin[CELLS], count[CELLS], s[CELLS];
#if DRIVE == EXACT_WIDTH
    double belief_origin[CELLS], belief_count[CELLS]; /* what the driver takes for true */
#endif
    double g[CELLS];                 /* S */
    double weight[READS];            /* of what columns read, with polarity and gain */
#if HAS_WIRES
    double grid[ROWS * COLUMNS];     /* S, of one tile by line */
    double guess[TILES][COLUMNS][ROWS * COLUMNS]; /* V, of the rows when a column is read */
    double v_row[ROWS], v_column[COLUMNS], w[ROWS * COLUMNS], work[11][ROWS * COLUMNS];
    int is_stale[TILES];             /* whether the weights are of other conductances */
#if DRIVES_LINES
    double middle[ROWS * COLUMNS];   /* S, in the middle of a pulse */
    double program_guess[TILES][PHASES][ROWS * COLUMNS];
    int fired[CELLS];                /* 1, -1 or 0, in this phase */
#endif
#endif
    long long clock;                 /* steps of the shift registers */
    long long steps_done;            /* since the start */
#if HAS_CYCLE_NOISE
    int pulses[CELLS];               /* events done */
#endif
    int ls[NEURONS];                 /* set by a spike, counts down */
    int spiked[NEURONS];             /* spikes in this timestep */
    int action;
    int failure;                     /* what was not found, a place in `failures` */
    signed char ring[SLOTS][NEURONS]; /* spikes by step: shift registers of the rows */
} Controller;

enum { NONE, WIRES, FLUX, PULSE };
static const char *const failures[] = {
    NULL,
    "expected the potentials of the wires to converge, got none that do",
    "expected the state that belongs to a pulse's flux, got none that converges",
    "expected a finite rate of the state in a pulse, got none",
};

#if HAS_READ_NOISE || HAS_CYCLE_NOISE
/* A standard normal number by the Box-Muller transform. */
static double normal(uint32_t key_low, uint32_t key_high, long long counter0, long long counter1)
{
    double numbers[4];
    draw(key_low, key_high, (uint32_t)counter0, (uint32_t)counter1, numbers);
    return sqrt(-2.0 * log(numbers[0])) * cos(2.0 * PI * numbers[1]);
}
#endif

static double weight_of(int t, double g, double subtracted)
{
    return tile_gain[t] * ((g - subtracted) / (tile_on[t] - tile_reference[t]));
}

#include "events.c"
#if HAS_WIRES
#include "lines.c"
#endif

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
        m->s[k] = cell_start[k];
        m->origin[k] = cell_origin[k];
#if DRIVE == EXACT_WIDTH
        m->belief_origin[k] = cell_belief[k];
#endif
        read_cell(m, k);
    }
#if HAS_WIRES
    for (k = 0; k < TILES; k++)
        m->is_stale[k] = 1;
#endif
}

/* The phases of the waveform on the rows and columns of all cells: through the wires, or on one cell after another. */
static void program(Controller *m)
{
#if DRIVES_LINES
    int t;
    for (t = 0; t < TILES; t++)
        if (tile_is_plastic[t])
            program_tile(m, t);
#else
    int j, k, phase;
    for (j = INPUTS; j < NEURONS; j++) {
        const int post = m->ls[j];
        for (k = first_cell[j]; k < first_cell[j + 1]; k++) {
            const int pre = m->ls[cell_sender[k]];
            double written = 0.0;
            if (!tile_is_plastic[cell_tile[k]] || !may_fire[pre][post])
                continue;
#if HAS_WIRES
            m->is_stale[cell_tile[k]] = 1;
#endif
            for (phase = 0; phase < PHASES; phase++) {
                const double level = column_level[phase][post] - row_level[phase][pre];
                const double sign = level > 0.0 ? 1.0 : -1.0, strength = fabs(level) / EVENT_LEVEL;
                const double v = strength * PULSE_VOLTAGE / (1.0 + cell_series[k] * m->g[k]);
                if (level == 0.0)
                    continue;
                if (cell_is_live[k] && v > cell_threshold[k]) {
                    write_pulse(m, k, sign, strength, event_size(m, k, sign) * phase_width[phase],
                                phase_width[phase]);
                    written += sign * phase_width[phase];
                } else if (COUNTS_HALF_SELECTS) {
                    half_select(m, k, sign);
                }
            }
            count_pulse(m, k, written);
        }
    }
#endif
}

#if READ_DISTURBS
/* What a step's reads do to the cells that are read: a positive row pulse depresses. */
static void disturb(Controller *m)
{
    int k;
    for (k = 0; k < first_cell[NEURONS]; k++) {
        const long long sent = m->clock - cell_tap[k];
        if (!cell_is_live[k] || sent < 0 || !m->ring[sent % SLOTS][cell_sender[k]])
            continue;
        count_events(m, k, cell_polarity[k] > 0.0 ? -READ_DISTURB : READ_DISTURB);
        read_cell(m, k);
#if HAS_WIRES
        m->is_stale[cell_tile[k]] = 1;
#endif
    }
}
#endif

#if AGES
/* What a timestep does to every state at rest. */
static void age(Controller *m)
{
    int k;
    for (k = 0; k < first_cell[NEURONS]; k++)
        if (cell_is_live[k]) {
            place_at(m, k, m->s[k] * DECAY);
            read_cell(m, k);
        }
#if HAS_WIRES
    for (k = 0; k < TILES; k++)
        m->is_stale[k] = 1;
#endif
}
#endif

/* What the periphery makes of a column's sum: settling, offset, noise, converter; `squares` of what was added. */
static double sensed(const Controller *m, int j, double total, double squares)
{
    total = total * SETTLED + neuron_offset[j];
#if HAS_READ_NOISE
    total += READ_NOISE * sqrt(squares) * normal(READ_KEY_LOW, READ_KEY_HIGH, j, m->steps_done);
#else
    (void)m;
    (void)squares;
#endif
#if BITS > 0
    if (neuron_full_scale[j] > 0.0) {
        const double part = 2.0 * neuron_full_scale[j] / (1 << BITS);
        total = fmin(fmax(part * floor(total / part + 0.5), -neuron_full_scale[j]), neuron_full_scale[j]);
    }
#endif
    return total;
}

static void controller_tick(const double *p, const double *sensors, Controller *m)
{
    int j, k;
#if HAS_WIRES
    for (k = 0; k < TILES; k++)
        if (m->is_stale[k])
            read_tile(m, k);
#endif
    for (j = 0; j < NEURONS; j++) {
        double current, y;
        if (j < INPUTS) {
            current = sensors[j];
        } else {
            double total = 0.0, squares = 0.0;
            for (k = first_read[j]; k < first_read[j + 1]; k++) {
                const long long sent = m->clock - read_tap[k];
                if (sent >= 0 && m->ring[sent % SLOTS][read_sender[k]]) {
                    total += m->weight[k];
                    squares += m->weight[k] * m->weight[k];
                }
            }
            current = p[GAIN] * sensed(m, j, total, squares);
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
#if READ_DISTURBS
    disturb(m);
#endif
    program(m);
    for (j = 0; j < NEURONS; j++)
        m->ls[j] -= m->ls[j] > 0;
    m->clock++;
    m->steps_done++;
}

/* A timestep; the action follows from the outputs' spike counts: 0 forward, 1 left, 2 right. NULL, or what failed. */
static const char *controller_step(const double *p, const double *sensors, Controller *m)
{
    int k, left, right;
#if AGES
    if (m->steps_done > 0)
        age(m);
#endif
    if (!CARRY_STATE)
        controller_rest(p, m);
    memset(m->spiked, 0, sizeof m->spiked);
    for (k = 0; k < STEPS; k++)
        controller_tick(p, sensors, m);
    left = m->spiked[NEURONS - 2] >= p[HIGH_COUNT];
    right = m->spiked[NEURONS - 1] >= p[HIGH_COUNT];
    m->action = left == right ? 0 : left ? 1 : 2;
    return failures[m->failure];
}
