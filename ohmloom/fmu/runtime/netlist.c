/*
 * Resistors, memristors, capacitors and sources between nodes. model.c, which includes this, has the tables. Nodes are
 * numbered: the free ones first, in an order in which the matrix is a band; then ground; then one for each voltage source,
 * which holds it against ground, and for each capacitor, which does so by a voltage that is a state. A device is a memristor
 * with a charge x, s = x/c in [0, 1], and the current G(s, v) v from p to n. States are charges, then capacitors' voltages.
 *
 * Kirchhoff's current law at the free nodes is solved for their potentials; matrices are symmetric and positive. Not so
 * where sources are controlled, or sources or capacitors stand between free nodes (IS_GENERAL): their currents are
 * unknowns that are numbered as free nodes are, and `links` is what they add: a share of one potential to the current into
 * another place.
 */
enum { GROUND = N_FREE, N_HELD = N_SOURCES + N_CAPACITORS, N_ALL = N_FREE + 1 + N_HELD };
#if IS_GENERAL
enum { WIDTH = N_FREE + 1 }; /* of a row, and where the row that took its place was */
#else
enum { WIDTH = BAND + 1 };
#endif
#define MOST_ROUNDS 100
#define MOST_HALVINGS 40
#define SMALL_STEP 1e-9 /* a Newton step of this share of the potentials leaves an error of its square */

/* Room for one solution; freed by the one who asked for it. */
typedef struct {
    double *v, *trial, *b;  /* by node; b: currents into free nodes, then what a solve made of them */
    double *matrix;         /* lower band, or all rows; factored */
    double *current, *slope; /* by device: i and di/dv */
} Work;

static int make_room(Work *w)
{
    memset(w, 0, sizeof *w);
    w->v = calloc(3 * (size_t)N_ALL + 2 * (size_t)N_DEVICES + (size_t)N_FREE * WIDTH, sizeof(double));
    if (!w->v)
        return 0;
    w->trial = w->v + N_ALL;
    w->b = w->trial + N_ALL;
    w->current = w->b + N_ALL;
    w->slope = w->current + N_DEVICES;
    w->matrix = w->slope + N_DEVICES;
    return 1;
}

static double state_of(const double *c, const double *x, int k) { return x[k] / c[device_kind[k]]; }

static double across(const double *v, int k) { return v[device_p[k]] - v[device_n[k]]; }

/* Potentials that sources and capacitors hold, or changes of them. */
static void hold(const double *u, const double *x, double *v)
{
    int k;
    for (k = 0; k < N_HELD; k++)
        v[GROUND + 1 + k] = held_sign[k] * (k < N_SOURCES ? u[k] : x[N_DEVICES + k - N_SOURCES]);
}

/* What stands at a place, from potentials, currents into nodes and currents of devices, or from changes of all three. */
static double at_place(const double *v, const double *into, const double *current, int kind, int place)
{
    return kind == POTENTIAL ? v[place]
         : kind == HELD ? held_sign[place] * into[GROUND + 1 + place]
         : kind == SENSE ? into[GROUND + 1 + place] : current[place];
}

#if IS_GENERAL
#define LEAST_PIVOT 1e-15 /* of the largest entry of its column */

static void add_entry(double *matrix, int row, int column, double value)
{
    if (row < N_FREE && column < N_FREE)
        matrix[row * WIDTH + column] += value;
}

/* Gauss' factors of all rows, by the largest pivot of each column. */
static int factor(Work *w)
{
    double *a = w->matrix;
    int k, i, j;
    memset(a, 0, sizeof(double) * (size_t)N_FREE * WIDTH);
    for (k = 0; k < N_RESISTORS + N_DEVICES; k++) {
        const int d = k - N_RESISTORS, p = d < 0 ? resistor_p[k] : device_p[d], n = d < 0 ? resistor_n[k] : device_n[d];
        const double g = d < 0 ? resistor_g[k] : w->slope[d];
        add_entry(a, p, p, g);
        add_entry(a, n, n, g);
        add_entry(a, p, n, -g);
        add_entry(a, n, p, -g);
    }
    for (k = 0; k < N_LINKS; k++)
        add_entry(a, link_to[k], link_from[k], -link_share[k]);
    for (k = 0; k < N_FREE; k++) {
        double most = 0.0;
        int best = k;
        for (i = 0; i < N_FREE; i++)
            most = fmax(most, fabs(a[i * WIDTH + k]));
        for (i = k + 1; i < N_FREE; i++)
            if (fabs(a[i * WIDTH + k]) > fabs(a[best * WIDTH + k]))
                best = i;
        if (!(fabs(a[best * WIDTH + k]) > LEAST_PIVOT * most))
            return 0;
        for (j = 0; j < N_FREE; j++) {
            const double kept = a[k * WIDTH + j];
            a[k * WIDTH + j] = a[best * WIDTH + j];
            a[best * WIDTH + j] = kept;
        }
        a[k * WIDTH + N_FREE] = best;
        for (i = k + 1; i < N_FREE; i++) {
            const double share = a[i * WIDTH + k] /= a[k * WIDTH + k];
            for (j = k + 1; share != 0.0 && j < N_FREE; j++)
                a[i * WIDTH + j] -= share * a[k * WIDTH + j];
        }
    }
    return 1;
}

static void change_places(double *b, int i, int j)
{
    const double kept = b[i];
    b[i] = b[j];
    b[j] = kept;
}

static void solve_factored(const Work *w, double *b)
{
    const double *a = w->matrix;
    int k, j;
    for (k = 0; k < N_FREE; k++)
        change_places(b, k, (int)a[k * WIDTH + N_FREE]);
    for (k = 0; k < N_FREE; k++)
        for (j = 0; j < k; j++)
            b[k] -= a[k * WIDTH + j] * b[j];
    for (k = N_FREE - 1; k >= 0; k--) {
        for (j = k + 1; j < N_FREE; j++)
            b[k] -= a[k * WIDTH + j] * b[j];
        b[k] /= a[k * WIDTH + k];
    }
}

static void solve_transposed(const Work *w, double *b)
{
    const double *a = w->matrix;
    int k, j;
    for (k = 0; k < N_FREE; k++) {
        for (j = 0; j < k; j++)
            b[k] -= a[j * WIDTH + k] * b[j];
        b[k] /= a[k * WIDTH + k];
    }
    for (k = N_FREE - 1; k >= 0; k--)
        for (j = k + 1; j < N_FREE; j++)
            b[k] -= a[j * WIDTH + k] * b[j];
    for (k = N_FREE - 1; k >= 0; k--)
        change_places(b, k, (int)a[k * WIDTH + N_FREE]);
}
#else
static void add_conductance(double *matrix, int p, int n, double g)
{
    const int high = p > n ? p : n, low = p > n ? n : p;
    if (low < N_FREE)
        matrix[low * WIDTH] += g;
    if (high < N_FREE) {
        matrix[high * WIDTH] += g;
        matrix[low * WIDTH + high - low] -= g;
    }
}

/* Cholesky's factors of a band: row k holds entry (k + j, k) at place j. */
static int factor(Work *w)
{
    int k, i, j;
    memset(w->matrix, 0, sizeof(double) * (size_t)N_FREE * WIDTH);
    for (k = 0; k < N_RESISTORS; k++)
        add_conductance(w->matrix, resistor_p[k], resistor_n[k], resistor_g[k]);
    for (k = 0; k < N_DEVICES; k++)
        add_conductance(w->matrix, device_p[k], device_n[k], w->slope[k]);
    for (k = 0; k < N_FREE; k++) {
        double *row = w->matrix + k * WIDTH;
        const int last = k + BAND < N_FREE ? BAND : N_FREE - 1 - k;
        if (!(row[0] > 0.0))
            return 0;
        row[0] = sqrt(row[0]);
        for (j = 1; j <= last; j++)
            row[j] /= row[0];
        for (i = 1; i <= last; i++) {
            double *other = w->matrix + (k + i) * WIDTH - i;
            const double share = row[i];
            if (share != 0.0)
                for (j = i; j <= last; j++)
                    other[j] -= share * row[j];
        }
    }
    return 1;
}

static void solve_factored(const Work *w, double *b)
{
    int k, j;
    for (k = 0; k < N_FREE; k++) {
        const double *row = w->matrix + k * WIDTH;
        const int last = k + BAND < N_FREE ? BAND : N_FREE - 1 - k;
        b[k] /= row[0];
        for (j = 1; j <= last; j++)
            b[k + j] -= row[j] * b[k];
    }
    for (k = N_FREE - 1; k >= 0; k--) {
        const double *row = w->matrix + k * WIDTH;
        const int last = k + BAND < N_FREE ? BAND : N_FREE - 1 - k;
        for (j = 1; j <= last; j++)
            b[k] -= row[j] * b[k + j];
        b[k] /= row[0];
    }
}

#define solve_transposed solve_factored
#endif

/* Adds a current from p through an element to n: what flows into each node. */
static void flow(double *into, int p, int n, double current)
{
    into[p] -= current;
    into[n] += current;
}

/* Into every node, at the potentials v, with the devices' currents as they stand in w. */
static void sum_currents(const double *u, const Work *w, const double *v, double *into)
{
    int k;
    memset(into, 0, sizeof(double) * (size_t)N_ALL);
    for (k = 0; k < N_RESISTORS; k++)
        flow(into, resistor_p[k], resistor_n[k], resistor_g[k] * (v[resistor_p[k]] - v[resistor_n[k]]));
    for (k = 0; k < N_CURRENTS; k++)
        flow(into, current_p[k], current_n[k], u[N_SOURCES + k]);
    for (k = 0; k < N_DEVICES; k++)
        flow(into, device_p[k], device_n[k], w->current[k]);
    for (k = 0; k < N_LINKS; k++)
        into[link_to[k]] += link_share[k] * v[link_from[k]];
}

/* Currents of the devices at the potentials v, and into the nodes; the largest that a free node is left with. */
static double unbalance(const double *p, const double *c, const double *u, const double *x, Work *w, const double *v)
{
    double most = 0.0;
    int k;
    for (k = 0; k < N_DEVICES; k++)
        w->current[k] = conductance(device_kind[k], state_of(c, x, k), across(v, k), p) * across(v, k);
    sum_currents(u, w, v, w->b);
    for (k = 0; k < N_FREE; k++)
        most = fabs(w->b[k]) > most || isnan(w->b[k]) ? fabs(w->b[k]) : most;
    return most;
}

static double largest(const double *numbers, int count)
{
    double most = 0.0;
    int k;
    for (k = 0; k < count; k++)
        most = fmax(most, fabs(numbers[k]));
    return most;
}

/* di/dv of every device. */
static void take_slopes(const double *p, const double *c, const double *x, Work *w, const double *v)
{
    int k;
    for (k = 0; k < N_DEVICES; k++) {
        const double s = state_of(c, x, k), volts = across(v, k);
        w->slope[k] = conductance(device_kind[k], s, volts, p);
        if (!IS_OHMIC)
            w->slope[k] += conductance_by_v(device_kind[k], s, volts, p) * volts;
    }
}

/* Potentials, currents, slopes and factors at the states x and inputs u. Ohmic devices take one solve; others Newton's
 * method, from the potentials at low field, with steps halved until the unbalance falls. */
static int solve(const double *p, const double *c, const double *u, const double *x, Work *w)
{
    double left;
    int k, round, halving;
    hold(u, x, w->v);
    for (k = 0; k < N_DEVICES; k++) {
        w->slope[k] = conductance(device_kind[k], state_of(c, x, k), 0.0, p);
        w->current[k] = w->slope[k] * across(w->v, k);
    }
    if (N_FREE == 0) { /* every node is held */
        if (!IS_OHMIC)
            unbalance(p, c, u, x, w, w->v);
        return 1;
    }
    sum_currents(u, w, w->v, w->b);
    if (!factor(w))
        return 0;
    solve_factored(w, w->b);
    memcpy(w->v, w->b, sizeof(double) * (size_t)N_FREE);
    if (IS_OHMIC) {
        for (k = 0; k < N_DEVICES; k++)
            w->current[k] = w->slope[k] * across(w->v, k);
        return 1;
    }
    left = unbalance(p, c, u, x, w, w->v);
    memcpy(w->trial, w->v, sizeof(double) * (size_t)N_ALL);
    for (round = 0; round < MOST_ROUNDS; round++) {
        double share = 1.0, found = left;
        int is_last;
        take_slopes(p, c, x, w, w->v);
        if (!factor(w))
            return 0;
        solve_factored(w, w->b);
        is_last = !(largest(w->b, N_FREE) > SMALL_STEP * largest(w->v, N_ALL));
        /* unbalance() writes over b: the step is kept where the old potentials stood. */
        for (k = 0; k < N_FREE; k++)
            w->trial[k] = w->b[k];
        for (halving = 0; halving < MOST_HALVINGS; halving++, share *= 0.5) {
            for (k = 0; k < N_FREE; k++)
                w->v[k] += share * w->trial[k];
            found = unbalance(p, c, u, x, w, w->v);
            if (is_last || found < left)
                break;
            for (k = 0; k < N_FREE; k++)
                w->v[k] -= share * w->trial[k];
        }
        if (is_last)
            return isfinite(found);
        if (halving == MOST_HALVINGS)
            return 0;
        left = found;
    }
    return 0;
}

/* Rates of the capacitors' voltages, from their currents. */
static void charge_capacitors(const Work *w, const double *v, double *rates)
{
    int k;
    for (k = 0; k < N_CAPACITORS; k++)
        rates[N_DEVICES + k] = at_place(v, w->b, w->current, capacitor_kind[k], capacitor_place[k]) / capacitance[k];
}

static void netlist_rates(const double *p, const double *c, const double *u, const double *x, double *rates)
{
    Work w;
    int k, is_solved = make_room(&w);
    if (is_solved)
        is_solved = solve(p, c, u, x, &w);
    for (k = 0; k < N_DEVICES; k++)
        rates[k] = is_solved ? charge_rate(device_kind[k], state_of(c, x, k), across(w.v, k), w.current[k], p) : NAN;
    if (is_solved && N_CAPACITORS) {
        sum_currents(u, &w, w.v, w.b);
        charge_capacitors(&w, w.v, rates);
    }
    for (k = N_DEVICES; !is_solved && k < N_X; k++)
        rates[k] = NAN;
    free(w.v);
}

static void read_outputs(const Work *w, const double *v, double *y)
{
    int k;
    for (k = 0; k < N_Y; k++)
        y[k] = at_place(v, w->b, w->current, output_kind[k], output_place[k]);
}

static void netlist_outputs(const double *p, const double *c, const double *u, const double *x, double *y)
{
    Work w;
    int k, is_solved = make_room(&w);
    if (is_solved)
        is_solved = solve(p, c, u, x, &w);
    if (is_solved) {
        sum_currents(u, &w, w.v, w.b);
        read_outputs(&w, w.v, y);
    }
    for (k = 0; !is_solved && k < N_Y; k++)
        y[k] = NAN;
    free(w.v);
}

/* Changes (drates, dy) for changes (du, dx): the same matrix, solved once more. */
static void netlist_forward(const double *p, const double *c, const double *u, const double *x, const double *du,
                            const double *dx, double *drates, double *dy)
{
    Work w;
    int k;
    if (!make_room(&w) || !solve(p, c, u, x, &w)) {
        for (k = 0; k < N_X; k++)
            drates[k] = NAN;
        for (k = 0; k < N_Y; k++)
            dy[k] = NAN;
        free(w.v);
        return;
    }
    take_slopes(p, c, x, &w, w.v);
    memset(w.trial, 0, sizeof(double) * (size_t)N_ALL); /* from here on: changes of potentials */
    hold(du, dx, w.trial);
    for (k = 0; k < N_DEVICES; k++) {
        const int kind = device_kind[k];
        const double s = state_of(c, x, k), v = across(w.v, k);
        drates[k] = conductance_by_s(kind, s, v, p) * v * dx[k] / c[kind]; /* so far: di at the old potentials */
        w.current[k] = drates[k] + w.slope[k] * across(w.trial, k);
    }
    sum_currents(du, &w, w.trial, w.b);
    solve_factored(&w, w.b);
    memcpy(w.trial, w.b, sizeof(double) * (size_t)N_FREE);
    for (k = 0; k < N_DEVICES; k++) {
        const int kind = device_kind[k];
        const double s = state_of(c, x, k), v = across(w.v, k), dv = across(w.trial, k);
        const double i = conductance(kind, s, v, p) * v;
        w.current[k] = drates[k] + w.slope[k] * dv;
        drates[k] = charge_rate_by_s(kind, s, v, i, p) * dx[k] / c[kind] + charge_rate_by_v(kind, s, v, i, p) * dv +
                    charge_rate_by_i(kind, s, v, i, p) * w.current[k];
    }
    sum_currents(du, &w, w.trial, w.b);
    charge_capacitors(&w, w.trial, drates);
    read_outputs(&w, w.trial, dy);
    free(w.v);
}

/* Adds to (du, dx) what (drates, dy) make of them: forward's steps, transposed, in reverse. */
static void netlist_adjoint(const double *p, const double *c, const double *u, const double *x, const double *drates,
                            const double *dy, double *du, double *dx)
{
    Work w;
    double *into, *potential; /* weights of currents into nodes, and of potentials */
    int k;
    if (!make_room(&w) || !solve(p, c, u, x, &w)) {
        for (k = 0; k < N_X; k++)
            dx[k] = NAN;
        free(w.v);
        return;
    }
    take_slopes(p, c, x, &w, w.v);
    into = w.trial, potential = w.b;
    memset(into, 0, sizeof(double) * (size_t)N_ALL);
    memset(potential, 0, sizeof(double) * (size_t)N_ALL);
    memset(w.current, 0, sizeof(double) * (size_t)N_DEVICES); /* from here on: weights of the devices' currents */
    for (k = 0; k < N_Y + N_CAPACITORS; k++) {
        const int n = k - N_Y, kind = n < 0 ? output_kind[k] : capacitor_kind[n];
        const int at = n < 0 ? output_place[k] : capacitor_place[n];
        const double weight = n < 0 ? dy[k] : drates[N_DEVICES + n] / capacitance[n];
        if (kind == POTENTIAL)
            potential[at] += weight;
        else if (kind == CURRENT)
            w.current[at] += weight;
        else
            into[GROUND + 1 + at] += (kind == HELD ? held_sign[at] : 1.0) * weight;
    }
    for (k = 0; k < N_DEVICES; k++) {
        const int kind = device_kind[k];
        const double s = state_of(c, x, k), v = across(w.v, k), i = conductance(kind, s, v, p) * v;
        double dv;
        w.current[k] += charge_rate_by_i(kind, s, v, i, p) * drates[k] + into[device_n[k]] - into[device_p[k]];
        dx[k] += charge_rate_by_s(kind, s, v, i, p) * drates[k] / c[kind];
        dv = charge_rate_by_v(kind, s, v, i, p) * drates[k] + w.slope[k] * w.current[k];
        potential[device_p[k]] += dv;
        potential[device_n[k]] -= dv;
    }
    for (k = 0; k < N_RESISTORS; k++) {
        const double dv = resistor_g[k] * (into[resistor_n[k]] - into[resistor_p[k]]);
        potential[resistor_p[k]] += dv;
        potential[resistor_n[k]] -= dv;
    }
    for (k = 0; k < N_LINKS; k++)
        potential[link_from[k]] += link_share[k] * into[link_to[k]];
    solve_transposed(&w, potential); /* now the free nodes' weights of what flows into them */
    memcpy(into, potential, sizeof(double) * (size_t)N_FREE);
    for (k = 0; k < N_CURRENTS; k++)
        du[N_SOURCES + k] += into[current_n[k]] - into[current_p[k]];
    memset(into + N_FREE, 0, sizeof(double) * (size_t)(N_ALL - N_FREE));
    for (k = 0; k < N_DEVICES; k++) {
        const double weight = into[device_n[k]] - into[device_p[k]], v = across(w.v, k);
        dx[k] += conductance_by_s(device_kind[k], state_of(c, x, k), v, p) * v * (w.current[k] + weight) /
                 c[device_kind[k]];
        if (device_p[k] > GROUND)
            potential[device_p[k]] += w.slope[k] * weight;
        if (device_n[k] > GROUND)
            potential[device_n[k]] -= w.slope[k] * weight;
    }
    for (k = 0; k < N_RESISTORS; k++) {
        const double dv = resistor_g[k] * (into[resistor_n[k]] - into[resistor_p[k]]);
        if (resistor_p[k] > GROUND)
            potential[resistor_p[k]] += dv;
        if (resistor_n[k] > GROUND)
            potential[resistor_n[k]] -= dv;
    }
    for (k = 0; k < N_LINKS; k++)
        if (link_from[k] > GROUND)
            potential[link_from[k]] += link_share[k] * into[link_to[k]];
    for (k = 0; k < N_HELD; k++)
        *(k < N_SOURCES ? du + k : dx + N_DEVICES + k - N_SOURCES) += held_sign[k] * potential[GROUND + 1 + k];
    free(w.v);
}
