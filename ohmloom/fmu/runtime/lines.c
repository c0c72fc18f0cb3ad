/*
 * An array with wires: what a column reads per volt on every row, and what every cell sees while all lines are driven.
 * Potentials by conjugate gradients on the row nodes, every wire eliminated exactly, from the last solution on: the
 * operations of ohmloom's own solver in their order, so that the bits are the same. Arrays have axes (node, line).
 */
enum { POINTS = ROWS * COLUMNS };

#ifndef MOST_ITERATIONS
#define MOST_ITERATIONS 2000
#endif
#define LINE_TOLERANCE 1e-11 /* of the potentials, in the norm of their energy */

typedef struct {
    double segment, near, far; /* Ohm; S before the first and after the last node, 0 is open, infinite is ideal */
} Wire;

static const Wire row_wire = {ROW_SEGMENT, ROW_NEAR, 0.0}, column_wire = {COLUMN_SEGMENT, 0.0, COLUMN_FAR};

/* Inverse pivots; without resistance, those of the whole line in node 0. */
static void factor_lines(Wire wire, int nodes, int lines, const double *g, double *factors)
{
    double *last = factors + (nodes - 1) * lines;
    const double c = 1.0 / wire.segment;
    int a, b;
    if (wire.segment == 0.0) {
        for (a = 0; a < lines; a++) {
            factors[a] = wire.near + wire.far;
            for (b = 0; b < nodes; b++)
                factors[a] += g[b * lines + a];
            factors[a] = factors[a] > 0.0 ? 1.0 / factors[a] : 1.0;
        }
        return;
    }
    for (a = 0; a < lines; a++) {
        double behind = wire.near, held; /* what holds a node from behind, in series with the segment to the next one */
        for (b = 0; b < nodes - 1; b++) {
            const double inverse = 1.0 / (behind + g[b * lines + a] + c);
            held = behind + g[b * lines + a];
            behind = c * held * inverse;
            factors[b * lines + a] = inverse;
        }
        held = behind + g[(nodes - 1) * lines + a] + wire.far;
        last[a] = held > 0.0 ? 1.0 / held : 1.0;
    }
}

/* Potentials for currents that are put in, terminations at zero. */
static void find_potential(Wire wire, int nodes, int lines, const double *factors, const double *put_in, double *out)
{
    const double c = 1.0 / wire.segment;
    int a, b;
    if (wire.segment == 0.0) {
        for (a = 0; a < lines; a++) {
            double sum = 0.0;
            for (b = 0; b < nodes; b++)
                sum += put_in[b * lines + a];
            for (b = 0; b < nodes; b++)
                out[b * lines + a] = sum * factors[a];
        }
        return;
    }
    for (a = 0; a < lines; a++)
        out[a] = put_in[a] * factors[a];
    for (b = 1; b < nodes; b++)
        for (a = b * lines; a < (b + 1) * lines; a++)
            out[a] = (put_in[a] + c * out[a - lines]) * factors[a];
    for (b = nodes - 2; b >= 0; b--)
        for (a = b * lines; a < (b + 1) * lines; a++)
            out[a] += c * factors[a] * out[a + lines];
}

/* Adds the currents that terminations put in; an ideal line gets none, its potential is what holds it. */
static void add_terminals(Wire wire, int nodes, int lines, const double *held, double *put_in)
{
    int a;
    if (isinf(wire.near + wire.far))
        return;
    for (a = 0; a < lines; a++) {
        put_in[a] += wire.near * held[a];
        put_in[(nodes - 1) * lines + a] += wire.far * held[a];
    }
}

static void add_ideal(Wire wire, int nodes, int lines, const double *held, double *out)
{
    int a, b;
    if (!isinf(wire.near + wire.far))
        return;
    for (b = 0; b < nodes; b++)
        for (a = 0; a < lines; a++)
            out[b * lines + a] += held[a];
}

static void turn(const double *x, double *out)
{
    int i, j;
    for (j = 0; j < COLUMNS; j++)
        for (i = 0; i < ROWS; i++)
            out[j * ROWS + i] = x[i * COLUMNS + j];
}

static void multiply(const double *g, const double *x, double *out)
{
    int k;
    for (k = 0; k < POINTS; k++)
        out[k] = g[k] * x[k];
}

static void turn_product(const double *g, const double *x, double *out)
{
    int i, j;
    for (j = 0; j < COLUMNS; j++)
        for (i = 0; i < ROWS; i++)
            out[j * ROWS + i] = g[i * COLUMNS + j] * x[i * COLUMNS + j];
}

/* Potentials u of the rows, from the guess that it holds, and w of the columns, while the lines are held. */
static void solve_lines(Controller *m, const double *g, double *u)
{
    double *column_factors = m->work[0], *put_in = m->work[1], *q = m->work[2], *row_factors = m->work[3];
    double *turned_g = m->work[4], *x = m->work[5], *r = m->work[6], *z = m->work[7], *p = m->work[8];
    double *ap = m->work[9], *other = m->work[10], *w = m->w, scale = 0.0, rz = 0.0;
    int i, j, k, count;
    turn(g, turned_g);
    factor_lines(row_wire, COLUMNS, ROWS, turned_g, row_factors);
    factor_lines(column_wire, ROWS, COLUMNS, g, column_factors);
    multiply(g, u, put_in);
    add_terminals(column_wire, ROWS, COLUMNS, m->v_column, put_in);
    find_potential(column_wire, ROWS, COLUMNS, column_factors, put_in, w);
    add_ideal(column_wire, ROWS, COLUMNS, m->v_column, w);
    multiply(g, w, put_in);
    turn(put_in, other);
    add_terminals(row_wire, COLUMNS, ROWS, m->v_row, other);
    find_potential(row_wire, COLUMNS, ROWS, row_factors, other, x);
    add_ideal(row_wire, COLUMNS, ROWS, m->v_row, x);
    for (j = 0; j < COLUMNS; j++)
        for (i = 0; i < ROWS; i++) {
            k = j * ROWS + i;
            scale += fabs(turned_g[k] * x[k] * x[k]) + fabs(other[k] * x[k]);
            p[k] = x[k] - u[i * COLUMNS + j];
            other[k] = turned_g[k] * p[k];
        }
    for (i = 0; i < ROWS; i++)
        for (j = 0; j < COLUMNS; j++)
            put_in[i * COLUMNS + j] = other[j * ROWS + i];
    find_potential(column_wire, ROWS, COLUMNS, column_factors, put_in, q);
    turn_product(g, q, r);
    find_potential(row_wire, COLUMNS, ROWS, row_factors, r, z);
    for (k = 0; k < POINTS; k++) {
        p[k] = z[k];
        ap[k] = r[k];
        rz += r[k] * z[k];
    }
    for (count = 0; !(rz <= LINE_TOLERANCE * LINE_TOLERANCE * scale); count++) { /* not a number is not solved */
        double pq = 0.0, after = 0.0, length, ratio;
        multiply(turned_g, p, other);
        for (i = 0; i < ROWS; i++)
            for (j = 0; j < COLUMNS; j++)
                put_in[i * COLUMNS + j] = other[j * ROWS + i];
        find_potential(column_wire, ROWS, COLUMNS, column_factors, put_in, q);
        turn_product(g, q, other);
        for (k = 0; k < POINTS; k++) {
            other[k] = ap[k] - other[k];
            pq += p[k] * other[k];
        }
        if (count == MOST_ITERATIONS || !(pq > 0.0)) {
            m->failure = m->failure ? m->failure : WIRES; /* the first is the cause */
            return;
        }
        length = rz / pq;
        for (k = 0; k < POINTS; k++) {
            x[k] += length * p[k];
            r[k] -= length * other[k];
        }
        find_potential(row_wire, COLUMNS, ROWS, row_factors, r, z);
        for (k = 0; k < POINTS; k++)
            after += r[k] * z[k];
        ratio = after / rz;
        for (k = 0; k < POINTS; k++) {
            p[k] = z[k] + ratio * p[k];
            ap[k] = r[k] + ratio * ap[k];
        }
        rz = after;
    }
    for (i = 0; i < ROWS; i++)
        for (j = 0; j < COLUMNS; j++)
            u[i * COLUMNS + j] = x[j * ROWS + i];
    multiply(g, u, put_in);
    add_terminals(column_wire, ROWS, COLUMNS, m->v_column, put_in);
    find_potential(column_wire, ROWS, COLUMNS, column_factors, put_in, w);
    add_ideal(column_wire, ROWS, COLUMNS, m->v_column, w);
}

static int place_of(int k) { return cell_row[k] * COLUMNS + cell_column[k]; }

static void fill_grid(Controller *m, int t)
{
    int k;
    memcpy(m->grid, still[t], sizeof m->grid);
    for (k = 0; k < first_cell[NEURONS]; k++)
        if (cell_tile[k] == t)
            m->grid[place_of(k)] = m->g[k];
}

/* By reciprocity, a volt on a sense gives the currents that a volt on each row would give it. */
static void read_tile(Controller *m, int t)
{
    double transfer[ROWS][COLUMNS];
    int i, j, k;
    memset(transfer, 0, sizeof transfer);
    fill_grid(m, t);
    memset(m->v_row, 0, sizeof m->v_row);
    for (j = 0; j < COLUMNS; j++) {
        if (column_neuron[t][j] < 0 && reference_column[t] != j)
            continue;
        memset(m->v_column, 0, sizeof m->v_column);
        m->v_column[j] = 1.0;
        solve_lines(m, m->grid, m->guess[t][j]);
        for (i = 0; i < ROWS; i++)
            for (k = i * COLUMNS; k < (i + 1) * COLUMNS; k++)
                transfer[i][j] += m->grid[k] * (m->w[k] - m->guess[t][j][k]);
    }
    for (k = 0; k < first_read[NEURONS]; k++)
        if (read_tile_of[k] == t) {
            const double *row = transfer[read_row[k]];
            const double subtracted = reference_column[t] >= 0 ? row[reference_column[t]] : 0.0;
            m->weight[k] = read_polarity[k] * weight_of(t, row[read_column[k]], subtracted);
        }
    m->is_stale[t] = 0;
}

#if DRIVES_LINES
/* Puts the levels of a phase on all lines; whether any is other than 0. */
static int hold_lines(Controller *m, int t, int phase)
{
    const double unit = PULSE_VOLTAGE / EVENT_LEVEL;
    int i, j, is_driven = 0;
    for (i = 0; i < ROWS; i++) {
        m->v_row[i] = row_neuron[t][i] >= 0 ? unit * row_level[phase][m->ls[row_neuron[t][i]]] : 0.0;
        is_driven |= m->v_row[i] != 0.0;
    }
    for (j = 0; j < COLUMNS; j++) {
        m->v_column[j] = column_neuron[t][j] >= 0 ? unit * column_level[phase][m->ls[column_neuron[t][j]]] : 0.0;
        is_driven |= m->v_column[j] != 0.0;
    }
    return is_driven;
}

/* Holds v over a cell for `size` pulses. */
static void hold_cell(Controller *m, int k, double v, double size)
{
#if INTEGRATES
    const int t = cell_tile[k];
    double charge;
    if (tile_is_integrated(t)) {
        end_at(m, k, pulse(HELD, t, m->s[k], v, tile_duration[t] * size, &charge));
        return;
    }
#endif
    count_events(m, k, v / PULSE_VOLTAGE * size);
}

/* A cell that switches takes the flux that it sees in the middle of its pulse; whether it does is decided by the voltage
 * at the start. */
static void program_tile(Controller *m, int t)
{
    double written[CELLS];
    int k, phase;
    memset(written, 0, sizeof written);
    fill_grid(m, t);
    for (phase = 0; phase < PHASES; phase++) {
        double *u = m->program_guess[t][phase];
        int any_fired = 0;
        if (!hold_lines(m, t, phase))
            continue;
        solve_lines(m, m->grid, u);
        for (k = 0; k < first_cell[NEURONS]; k++) {
            const double v = cell_tile[k] == t ? m->w[place_of(k)] - u[place_of(k)] : 0.0;
            m->fired[k] = 0;
            if (cell_tile[k] == t && cell_is_live[k] && fabs(v) > cell_threshold[k]) {
                m->fired[k] = v > 0.0 ? 1 : -1;
                written[k] += m->fired[k] * phase_width[phase];
                any_fired = 1;
            } else if (fabs(v) > 1e-15) {
                half_select(m, k, v > 0.0 ? 1.0 : -1.0);
            }
        }
        if (!any_fired)
            continue;
        memcpy(m->middle, m->grid, sizeof m->middle);
        for (k = 0; k < first_cell[NEURONS]; k++)
            if (m->fired[k]) {
                const double s = m->s[k], origin = m->origin[k], count = m->count[k];
                hold_cell(m, k, m->w[place_of(k)] - u[place_of(k)],
                          0.5 * phase_width[phase] * event_size(m, k, m->fired[k]));
                m->middle[place_of(k)] = conductance(t, m->s[k]);
                m->s[k] = s;
                m->origin[k] = origin;
                m->count[k] = count;
            }
        solve_lines(m, m->middle, u);
        for (k = 0; k < first_cell[NEURONS]; k++)
            if (m->fired[k]) {
                hold_cell(m, k, m->w[place_of(k)] - u[place_of(k)],
                          phase_width[phase] * event_size(m, k, m->fired[k]));
                read_cell(m, k);
            }
        fill_grid(m, t);
    }
    for (k = 0; k < first_cell[NEURONS]; k++)
        count_pulse(m, k, written[k]);
    m->is_stale[t] = 1;
}
#endif
