/*
 * A die as a controller: 21 steps of the network in a timestep, every synapse a device that follows its own law. model.c,
 * which includes this, holds the die: its cells, sorted by receiver, then sender, what the waveform asks of them, and
 * its neurons. Cells are programmed one by one; an event is a charge, in thousandths of the device's, so its state is
 * an origin and a count of events since, which a wall takes over. Columns read the cells themselves, or, with wires, what
 * is left of every row's voltage: the array is solved anew whenever a device has moved.
 */
enum { INPUTS = 6, STEPS = 21 };
enum { C, C_INI, GAIN, HIGH_COUNT }; /* parameters, in this order */

typedef struct {
    double y[NEURONS];               /* membrane potentials */
    double origin[CELLS], count[CELLS], s[CELLS];
    double g[CELLS];                 /* S */
    double weight[READS];            /* of what columns read, with polarity and gain */
#if HAS_WIRES
    double matrix[NODES][BAND + 1], potential[NODES];
    int is_stale[TILES];             /* whether the weights are of other conductances */
#endif
    long long clock;                 /* steps done */
    int ls[NEURONS];                 /* set by a spike, counts down */
    int spiked[NEURONS];             /* spikes in this timestep */
    int action;
    signed char ring[SLOTS][NEURONS]; /* spikes by step: shift registers of the rows */
} Controller;

static double weight_of(int t, double g, double subtracted)
{
    return tile_gain[t] * ((g - subtracted) / (tile_on[t] - tile_reference[t]));
}

#if HAS_WIRES
/* Row and column nodes in the order that keeps the band narrow. */
static int row_node(int i, int j) { return 2 * (ROWS < COLUMNS ? j * ROWS + i : i * COLUMNS + j); }
static int column_node(int i, int j) { return row_node(i, j) + 1; }

/* A conductance between two nodes, or from one to a line that is held. */
static void join(Controller *m, int p, int n, double g)
{
    const int high = p > n ? p : n, low = p > n ? n : p;
    m->matrix[high][0] += g;
    if (low >= 0) {
        m->matrix[low][0] += g;
        m->matrix[low][high - low] -= g;
    }
}

static void build_matrix(Controller *m, int t)
{
    int i, j, k;
    memset(m->matrix, 0, sizeof m->matrix);
    for (i = 0; i < ROWS; i++)
        for (j = 0; j < COLUMNS; j++) {
            join(m, row_node(i, j), column_node(i, j), still[t][i][j]);
            join(m, row_node(i, j), j + 1 < COLUMNS ? row_node(i, j + 1) : -1, j + 1 < COLUMNS ? ROW_G : 0.0);
            join(m, column_node(i, j), i + 1 < ROWS ? column_node(i + 1, j) : -1, i + 1 < ROWS ? COLUMN_G : SENSE_G);
        }
    for (i = 0; i < ROWS; i++)
        join(m, row_node(i, 0), -1, DRIVER_G);
    for (k = 0; k < first_cell[NEURONS]; k++)
        if (cell_tile[k] == t)
            join(m, row_node(cell_row[k], cell_column[k]), column_node(cell_row[k], cell_column[k]), m->g[k]);
}

/* Cholesky's factors of the band: row k holds entry (k + j, k) at place j. */
static void factor_matrix(Controller *m)
{
    int k, i, j;
    for (k = 0; k < NODES; k++) {
        double *row = m->matrix[k];
        const int last = k + BAND < NODES ? BAND : NODES - 1 - k;
        row[0] = sqrt(row[0]);
        for (j = 1; j <= last; j++)
            row[j] /= row[0];
        for (i = 1; i <= last; i++)
            for (j = i; row[i] != 0.0 && j <= last; j++)
                m->matrix[k + i][j - i] -= row[i] * row[j];
    }
}

static void solve_matrix(Controller *m)
{
    double *b = m->potential;
    int k, j;
    for (k = 0; k < NODES; k++) {
        b[k] /= m->matrix[k][0];
        for (j = 1; j <= BAND && k + j < NODES; j++)
            b[k + j] -= m->matrix[k][j] * b[k];
    }
    for (k = NODES - 1; k >= 0; k--) {
        for (j = 1; j <= BAND && k + j < NODES; j++)
            b[k] -= m->matrix[k][j] * b[k + j];
        b[k] /= m->matrix[k][0];
    }
}

/* By reciprocity, a volt on a sense gives the currents that a volt on each row would give it. */
static void read_tile(Controller *m, int t)
{
    double transfer[ROWS][COLUMNS];
    int i, j, k;
    memset(transfer, 0, sizeof transfer);
    build_matrix(m, t);
    factor_matrix(m);
    for (j = 0; j < COLUMNS; j++) {
        if (!column_is_read[t][j])
            continue;
        memset(m->potential, 0, sizeof m->potential);
        m->potential[column_node(ROWS - 1, j)] = SENSE_G;
        solve_matrix(m);
        for (i = 0; i < ROWS; i++)
            transfer[i][j] = DRIVER_G * m->potential[row_node(i, 0)];
    }
    for (k = 0; k < first_read[NEURONS]; k++)
        if (read_tile_of[k] == t) {
            const double *row = transfer[read_row[k]];
            const double subtracted = reference_column[t] >= 0 ? row[reference_column[t]] : 0.0;
            m->weight[k] = read_polarity[k] * weight_of(t, row[read_column[k]], subtracted);
        }
    m->is_stale[t] = 0;
}
#endif

static void read_cell(Controller *m, int k)
{
    const int t = cell_tile[k];
    m->g[k] = cell_is_live[k] ? conductance(t, m->s[k]) : cell_fixed[k];
#if HAS_WIRES
    m->is_stale[t] = 1;
#else
    m->weight[k] = read_polarity[k] * weight_of(t, m->g[k], tile_reference[t]);
#endif
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
        for (k = first_cell[j]; k < first_cell[j + 1]; k++) {
            const int pre = m->ls[cell_sender[k]];
            if (!cell_is_live[k] || !may_fire[pre][post])
                continue;
            for (phase = 0; phase < PHASES; phase++) {
                const double level = column_level[phase][post] - row_level[phase][pre];
                const double sign = level > 0.0 ? 1.0 : -1.0;
                const double v = fabs(level) / EVENT_LEVEL * PULSE_VOLTAGE / (1.0 + cell_series[k] * m->g[k]);
                if (level != 0.0 && v > cell_threshold[k])
                    move_charge(m, k, sign * (cell_factor[k] * (1.0 + sign * ASYMMETRY) * phase_width[phase]));
            }
        }
    }
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
            double total = 0.0;
            for (k = first_read[j]; k < first_read[j + 1]; k++) {
                const long long sent = m->clock - read_tap[k];
                if (sent >= 0 && m->ring[sent % SLOTS][read_sender[k]])
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
