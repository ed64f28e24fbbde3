/* The march of a structure with nonlinear joints; see `dynid.structure.nonlinear.march`, whose steps these are. */
#include <complex.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "laws.h"
#include "products.h"

#define NODES 5     /* Lobatto nodes of a step */
#define INNER 4     /* those with unknowns */
#define LOADS 9     /* coefficients of the loads of a step */
#define GUARDS 2
#define MAX_NEWTON 30
#define MAX_EVENTS 200
#define MAX_LOCATIONS 12
#define NEWTON_TOL 1e-12
#define EVENT_TOL 1e-12
#define GUARD_ROUND_OFF 4e-15 /* of a guard, over the sizes of what it is made of: some units in the last place */

#define DONE 0
#define NEEDS_REGIME 1
#define NOT_DIAGONAL 2
#define TOO_LONG 3
#define NEEDS_MEMORY 4

#define FIRST_LOOPS 3 /* first loading, its mirror image, a reversal: closing the last leads back to first loading */

typedef struct {
  /* n states, nf joint forces, nu loads, nd directions, nr rows (of which ns are needed to solve a step, the others for
   * its energy), nl laws, q columns of slopes, p of parameters, m modes */
  int64_t n, nf, nu, nd, nr, ns, nl, q, p, m, steps, lengths, regimes, scans, impulse, memory;
  const double *rows, *D, *rate_A, *rate_D; /* nr x n, n x nd; acceleration of the deflections: nf x n, nf x nd */
  const int64_t *codes, *places;            /* nl */
  const double *options, *values, *offsets, *statics; /* nl x OPTIONS, nl x VALUES, nl, nl x 2 + VALUES */
  const double *by_laws, *by_rows, *by_loads, *by_forces;
  const double *h, *fades, *coefficients, *nodes, *basis, *integrals, *scan, *scan_basis, *load_basis, *load_points, *load_inverse, *load_powers, *legendre, *two_steps, *jump, *jump_work;
  const int64_t *which, *sample;
  /* Of each regime: folded stiffness and damping (nf); of each length tables, whose last axis (`wide`) is that of the
   * forces at all nodes, then of the loads' coefficients, then of further forces at all nodes; modes (complex). */
  const double *k, *c, *P, *Q, *TR, *beyond, *TI, *lam, *V, *iV, *iVD, *RV;
  const int64_t *diagonal;
  /* The state, with which a march goes on. */
  double *x, *z, *S, *T, *work, *done, *wanted; /* work: on the laws (nf), of loads, on dampers; error of the state, its largest */
  int64_t *state, *at, *open; /* regimes of the laws; step, events, steps taken, jumped; reversals that are remembered */
  double *began, *began_slopes, *loops, *loop_slopes; /* forces at which branches began (nl, q); nl x memory x 2 (x q) */
  double *states, *hidden, *forces, *works, *slopes, *force_slopes, *hidden_slopes;
  int64_t *regime_of;
} March;

INLINE int64_t further_at(const March *t) { return NODES * t->nf + LOADS * t->nu; }
INLINE int64_t wide(const March *t) { return NODES * (t->nd - t->nu) + LOADS * t->nu; }

typedef struct {
  double value, d, v, z, p[SLOPES];
  int64_t following, unused; /* a size that registers clear */
} Guard;

/* A step in room that is used again: nodes x … as in the march of NumPy. */
typedef struct {
  double h, *P, *Q, *TR, *TI; /* tables; of a part of a step TI alone, and its modes: */
  double complex *E, *weights, *begun, *y; /* INNER x m, INNER x NODES x m; without forces, and with: INNER x m */
  double *Y; /* of slopes: real and imaginary parts at the beginning, and at the end (4 x m x q) */
  double *u, *powers, *w, *z, *g, *linear, *J, *right, *moved;
  Force *law; /* NODES x nl */
  double *f, *fd, *fv; /* NODES x nf: total force and slopes */
  int64_t *pivots, *dynamic, count;
  double *own_TI, *next, *norms, *before, before_h; /* norms of the loads' directions; forces of the step before */
  double *W, *further, *direct, *G, *Z;
  int64_t regime;
  int partial;
} Step;

INLINE void force(const March *t, int64_t l, int64_t r, double d, double v, double z, Force *o) {
  law_force(t->codes[l], t->values + VALUES * l, t->statics + (2 + VALUES) * l, t->options + OPTIONS * l, t->offsets[l],
            t->began[l], r, d, v, z, o);
}

/* Fill the guards of a regime; return their number. */
INLINE int guards(const March *t, int64_t l, int64_t r, double d, double v, double z, Guard *g) {
  const double *p = t->values + VALUES * l, *opt = t->options + OPTIONS * l;
  int count = 0;
  for (int k = 0; k < GUARDS; k++) cleared((double *)(g + k), sizeof *g / sizeof(double));
  if (t->codes[l] == 1) {
    const double x[2] = {d + t->offsets[l], v};
    for (int which = 0; which < 2; which++)
      if (kinked(opt, which)) {
        const double sign = r >> which & 1 ? -1.0 : 1.0;
        Guard *o = g + count++;
        o->value = sign * x[which], o->following = r ^ 1 << which;
        if (which) o->v = sign;
        else o->d = o->p[SLOPES - 1] = sign;
      }
  } else if (t->codes[l] == 2) {
    if (r) {
      g->value = r * v, g->v = r, g->following = 0;
      return 1;
    }
    for (int s = 1; s >= -1; s -= 2) {
      Guard *o = g + count++;
      o->value = p[1] - s * p[0] * (d - z), o->d = -s * p[0], o->z = s * p[0], o->following = s;
      o->p[0] = -s * (d - z), o->p[1] = 1.0;
    }
  } else if (t->codes[l] == 3) {
    const double of_v = r & 1 ? -1.0 : 1.0, of_e = r & 2 ? -1.0 : 1.0;
    g[0].value = of_v * v, g[0].v = of_v, g[0].following = r ^ 1;
    g[1].value = of_e * (d - z), g[1].d = of_e, g[1].z = -of_e, g[1].following = r ^ 2;
    return 2;
  } else if (t->codes[l] == 4) {
    d += t->offsets[l];
    if (r) {
      g->value = r * d - p[1], g->d = g->p[SLOPES - 1] = r, g->p[1] = -1.0, g->following = 0;
      return 1;
    }
    for (int s = 1; s >= -1; s -= 2)
      if (opt[s > 0 ? 0 : 1] != 0.0) {
        Guard *o = g + count++;
        o->value = p[1] - s * d, o->d = o->p[SLOPES - 1] = -s, o->p[1] = 1.0, o->following = s;
      }
  } else if (t->codes[l] == IWAN) {
    const double sign = sign_of(r);
    g[0].value = sign * v, g[0].v = sign, g[0].following = (r ^ BACKWARDS) | REVERSED;
    if (!(r & (SLIPPED | REVERSED))) {
      g[1].value = all_slip(p, g[1].p) - sign * (d - z), g[1].d = -sign, g[1].z = sign, g[1].following = r | SLIPPED;
    } else if (r & REVERSED) { /* the loop is closed where the branch before it was left */
      const double closing = t->loops[2 * (t->memory * l + t->open[l] - 1)];
      g[1].value = sign * (closing - d), g[1].d = -sign, g[1].following = t->open[l] <= FIRST_LOOPS ? r & ~(int64_t)REVERSED : r;
    } else {
      return 1;
    }
    return 2;
  }
  return count;
}

INLINE void tangent(const March *t, int64_t l, int64_t r, double *k, double *c) {
  const double *p = t->values + VALUES * l, *o = t->options + OPTIONS * l;
  *k = *c = 0.0;
  if (t->codes[l] == 1) {
    if (o[0] == 1.0 && o[1] == 0.0 && o[2] != 0.0) *k = p[0];
    if (o[1] == 1.0 && o[0] == 0.0 && o[3] != 0.0) *c = p[0];
  } else if (t->codes[l] == 2) {
    *k = r ? 0.0 : p[0];
  } else if (t->codes[l] == 3) {
    *k = p[0];
  } else if (t->codes[l] == 4 && r) {
    *k = p[0], *c = p[2];
  } else if (t->codes[l] == IWAN) {
    *k = (r & (SLIPPED | REVERSED)) == SLIPPED ? 0.0 : p[0];
  }
}

/* Return the place of the regime whose folded tangents are those of the laws, or -1 and what is wanted. */
INLINE int64_t place_of(const March *t) {
  memset(t->wanted, 0, 2 * t->nf * sizeof(double));
  for (int64_t l = 0; l < t->nl; l++) {
    double k, c;
    tangent(t, l, t->state[l], &k, &c);
    t->wanted[t->places[l]] += k;
    t->wanted[t->nf + t->places[l]] += c;
  }
  for (int64_t r = 0; r < t->regimes; r++)
    if (!memcmp(t->k + r * t->nf, t->wanted, t->nf * sizeof(double)) &&
        !memcmp(t->c + r * t->nf, t->wanted + t->nf, t->nf * sizeof(double)))
      return r;
  return -1;
}

/* Complex numbers by their parts: the products of C look for infinities, in a call each. */
INLINE double complex complex_of(double re, double im) {
  double complex z;
  __real__ z = re, __imag__ z = im;
  return z;
}
static const double factorial[] = {1.0, 1.0, 2.0, 6.0, 24.0, 120.0, 720.0, 5040.0, 40320.0, 362880.0};

INLINE double complex times(double complex a, double complex b) {
  return complex_of(creal(a) * creal(b) - cimag(a) * cimag(b), creal(a) * cimag(b) + cimag(a) * creal(b));
}
INLINE double real_of(double complex a, double complex b) { return creal(a) * creal(b) - cimag(a) * cimag(b); }

INLINE double scalar(int64_t n, const double *a, const double *b) {
  Aligned even = {0}, odd = {0};
  int64_t i = 0;
  for (; i + 2 * WIDE <= n; i += 2 * WIDE) {
    even += load(a + i) * load(b + i);
    odd += load(a + i + WIDE) * load(b + i + WIDE);
  }
  double sum = total(even + odd);
  for (; i < n; i++) sum += a[i] * b[i];
  return sum;
}

INLINE void phi_functions(double complex z, double complex *out) {
  out[0] = cexp(z);
  const double size = creal(z) * creal(z) + cimag(z) * cimag(z);
  if (size > 16.0) {
    const double complex inverse = complex_of(creal(z) / size, -cimag(z) / size);
    for (int k = 0; k < LOADS; k++) out[k + 1] = times(out[k] - 1.0 / factorial[k], inverse);
    return;
  }
  double complex term = 1.0 / factorial[LOADS], last = term;
  for (int k = 1; k < 30; k++) {
    term = times(term, z) / (LOADS + k);
    last += term;
  }
  out[LOADS] = last;
  for (int k = LOADS - 1; k > 0; k--) out[k] = times(z, out[k + 1]) + 1.0 / factorial[k];
}

/* Loads at parts of a regular step, by Clenshaw's recurrence. */
INLINE void loads_at(const March *t, int64_t step, double theta, double *u) {
  const double *a = t->coefficients + step * LOADS * t->nu, x = 2.0 * theta - 1.0;
  for (int64_t k = 0; k < t->nu; k++) {
    double b1 = 0.0, b2 = 0.0;
    for (int i = LOADS - 1; i > 0; i--) {
      const double b = 2.0 * x * b1 - b2 + a[i * t->nu + k];
      b2 = b1, b1 = b;
    }
    u[k] = x * b1 - b2 + a[k];
  }
}

/* Fill the loads at the nodes of a part of a regular step, and of a part their powers of time. */
static void loads_over(const March *t, Step *o, int64_t step, double begin, double part) {
  const int64_t nu = t->nu;
  if (part < 1.0) {
    for (int e = 0; e < NODES; e++) loads_at(t, step, begin + part * t->nodes[e], o->u + e * nu);
    /* By Chebyshev's polynomials: powers from values would lose five digits. */
    double *at = o->powers + LOADS * nu, *series = at + nu;
    memset(o->powers, 0, LOADS * nu * sizeof(double)), memset(series, 0, LOADS * nu * sizeof(double));
    for (int i = 0; i < LOADS; i++) {
      loads_at(t, step, begin + part * t->load_points[i], at);
      for (int k = 0; k < LOADS; k++)
        for (int64_t j = 0; j < nu; j++) series[k * nu + j] += t->load_inverse[k * LOADS + i] * at[j];
    }
    for (int i = 0; i < LOADS; i++)
      for (int k = 0; k <= i; k++)
        for (int64_t j = 0; j < nu; j++) o->powers[k * nu + j] += t->load_powers[i * LOADS + k] * series[i * nu + j];
    return;
  }
  memset(o->u, 0, NODES * nu * sizeof(double));
  for (int e = 0; e < NODES; e++)
    for (int i = 0; i < LOADS; i++)
      for (int64_t j = 0; j < nu; j++)
        o->u[e * nu + j] += t->load_basis[e * LOADS + i] * t->coefficients[(step * LOADS + i) * nu + j];
}

/* Point the step at the tables of a regular step, or make what a part of one needs by the modes. */
static int tables(const March *t, Step *o, int64_t regime, int64_t step, double begin, double part) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nd = t->nd, nr = t->nr, ns = t->ns, m = t->m, width = wide(t);
  const int64_t length = t->which[step], at = regime * t->lengths + length;
  const double h = t->h[length] * part;
  o->regime = regime;
  o->h = h;
  o->partial = part < 1.0;
  if (o->partial && !t->diagonal[regime]) return NOT_DIAGONAL;
  loads_over(t, o, step, begin, part);
  if (!o->partial) {
    o->P = (double *)t->P + at * n * n, o->Q = (double *)t->Q + at * n * width;
    o->TR = (double *)t->TR + at * INNER * nr * n, o->TI = (double *)t->TI + at * INNER * nr * width;
    return DONE;
  }
  o->TI = o->own_TI;
  const double complex *lam = (const double complex *)t->lam + regime * m;
  const double complex *iV = (const double complex *)t->iV + regime * m * n;
  const double complex *iVD = (const double complex *)t->iVD + regime * m * nd;
  const double complex *RV = (const double complex *)t->RV + regime * nr * m;
  for (int64_t i = 0; i < m; i++) {
    const double *right = (const double *)(iV + i * n);
    double re = 0.0, im = 0.0;
    for (int64_t s = 0; s < n; s++) re += right[2 * s] * t->x[s], im += right[2 * s + 1] * t->x[s];
    o->y[i] = complex_of(re, im);
  }
  for (int e = 0; e < INNER; e++) {
    const double c = t->nodes[e + 1];
    double complex *weights = o->weights + e * NODES * m;
    double by[NODES][NODES], scale[LOADS], raised = h * c;
    for (int k = 0; k < LOADS; k++, raised *= c) scale[k] = factorial[k] * raised;
    for (int j = 0; j < NODES; j++)
      for (int k = 0; k < NODES; k++) by[j][k] = t->basis[j * NODES + k] * scale[k];
    for (int64_t i = 0; i < m; i++) {
      double complex phi[LOADS + 1];
      phi_functions(lam[i] * (h * c), phi);
      o->E[e * m + i] = phi[0];
      for (int j = 0; j < NODES; j++) {
        double re = 0.0, im = 0.0;
        for (int k = 0; k < NODES; k++) re += by[j][k] * creal(phi[k + 1]), im += by[j][k] * cimag(phi[k + 1]);
        weights[j * m + i] = complex_of(re, im);
      }
      double complex sum = times(phi[0], o->y[i]);
      for (int64_t j = 0; j < nu; j++) {
        double re = 0.0, im = 0.0;
        for (int k = 0; k < LOADS; k++) {
          const double power = scale[k] * o->powers[k * nu + j];
          re += power * creal(phi[k + 1]), im += power * cimag(phi[k + 1]);
        }
        sum += times(complex_of(re, im), iVD[i * nd + nf + j]);
      }
      o->begun[e * m + i] = sum;
    }
    for (int64_t r = 0; r < ns; r++)
      for (int group = 0; group < 2; group++) { /* to joint forces, and to further ones */
        const int64_t first = group ? nf + nu : 0, count = group ? nd - nf - nu : nf;
        double *to_force = o->TI + (e * nr + r) * width + (group ? further_at(t) : 0);
        for (int j = 0; j < NODES; j++, to_force += count) {
          memset(to_force, 0, count * sizeof(double));
          for (int64_t i = 0; i < m && count; i++) {
            const double complex b = times(RV[r * m + i], weights[j * m + i]);
            const double *right = (const double *)(iVD + i * nd + first);
            for (int64_t s = 0; s < count; s++) to_force[s] += creal(b) * right[2 * s] - cimag(b) * right[2 * s + 1];
          }
        }
      }
  }
  return DONE;
}

/* Evaluate the laws at a node. */
INLINE void evaluate(const March *t, Step *o, int e) {
  const int64_t nf = t->nf;
  double *f = o->f + e * nf, *fd = o->fd + e * nf, *fv = o->fv + e * nf;
  memset(f, 0, nf * sizeof(double)), memset(fd, 0, nf * sizeof(double)), memset(fv, 0, nf * sizeof(double));
  for (int64_t l = 0; l < t->nl; l++) {
    Force *law = o->law + e * t->nl + l;
    const int64_t row = t->places[l];
    force(t, l, t->state[l], o->w[e * t->nr + row], o->w[e * t->nr + nf + row], o->z[e * t->nl + l], law);
    f[row] += law->f, fd[row] += law->d, fv[row] += law->v;
  }
}

/* Factorise in place with row exchanges; 0 if singular. */
static int factorise(int64_t n, double *A, int64_t *pivots) {
  for (int64_t k = 0; k < n; k++) {
    int64_t pivot = k;
    for (int64_t i = k + 1; i < n; i++)
      if (fabs(A[i * n + k]) > fabs(A[pivot * n + k])) pivot = i;
    pivots[k] = pivot;
    if (!(fabs(A[pivot * n + k]) > 0.0) || isinf(A[pivot * n + k])) return 0;
    if (pivot != k)
      for (int64_t j = 0; j < n; j++) {
        const double swapped = A[k * n + j];
        A[k * n + j] = A[pivot * n + j], A[pivot * n + j] = swapped;
      }
    for (int64_t i = k + 1; i < n; i++) {
      const double by = A[i * n + k] /= A[k * n + k];
      if (by != 0.0)
        for (int64_t j = k + 1; j < n; j++) A[i * n + j] -= by * A[k * n + j];
    }
  }
  return 1;
}

static void solve(int64_t n, const double *A, const int64_t *pivots, int64_t columns, double *B) {
  for (int64_t k = 0; k < n; k++)
    if (pivots[k] != k)
      for (int64_t j = 0; j < columns; j++) {
        const double swapped = B[k * columns + j];
        B[k * columns + j] = B[pivots[k] * columns + j], B[pivots[k] * columns + j] = swapped;
      }
  for (int64_t i = 1; i < n; i++)
    for (int64_t k = 0; k < i; k++)
      if (A[i * n + k] != 0.0)
        for (int64_t j = 0; j < columns; j++) B[i * columns + j] -= A[i * n + k] * B[k * columns + j];
  for (int64_t i = n - 1; i >= 0; i--) {
    for (int64_t k = i + 1; k < n; k++)
      if (A[i * n + k] != 0.0)
        for (int64_t j = 0; j < columns; j++) B[i * columns + j] -= A[i * n + k] * B[k * columns + j];
    for (int64_t j = 0; j < columns; j++) B[i * columns + j] /= A[i * n + i];
  }
}

/* Fill the matrix of Newton's iteration; unknowns: forces at nodes 1 … 4, then hidden states there. */
static void jacobian(const March *t, Step *o) {
  const int64_t nf = t->nf, nr = t->nr, nl = t->nl, nz = o->count, size = INNER * (nf + nz), width = wide(t);
  const double *k = t->k + o->regime * nf, *c = t->c + o->regime * nf;
  double *J = o->J;
  memset(J, 0, size * size * sizeof(double));
  for (int64_t i = 0; i < size; i++) J[i * size + i] = 1.0;
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t row = 0; row < nf; row++) {
      double *line = J + ((e - 1) * nf + row) * size;
      const double by_d = o->fd[e * nf + row] - k[row], by_v = o->fv[e * nf + row] - c[row];
      const double *d = o->TI + ((e - 1) * nr + row) * width, *v = o->TI + ((e - 1) * nr + nf + row) * width;
      for (int64_t j = 0; j < INNER * nf; j++) line[j] -= by_d * d[nf + j] + by_v * v[nf + j];
    }
  for (int64_t i = 0; i < nz; i++) {
    const int64_t l = o->dynamic[i], row = t->places[l];
    for (int64_t e = 1; e < NODES; e++) {
      J[((e - 1) * nf + row) * size + INNER * nf + (e - 1) * nz + i] -= o->law[e * nl + l].z;
      double *line = J + (INNER * nf + (e - 1) * nz + i) * size;
      for (int64_t j = 1; j < NODES; j++) {
        const Force *law = o->law + j * nl + l;
        const double a = t->integrals[e * NODES + j] * o->h;
        const double *d = o->TI + ((j - 1) * nr + row) * width, *v = o->TI + ((j - 1) * nr + nf + row) * width;
        for (int64_t m = 0; m < INNER * nf; m++) line[m] -= a * (law->rd * d[nf + m] + law->rv * v[nf + m]);
        line[INNER * nf + (j - 1) * nz + i] -= a * law->rz;
      }
    }
  }
}

INLINE void fill_rows(const March *t, Step *o) {
  const int64_t count = NODES * t->nf, width = wide(t);
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t r = 0; r < t->ns; r++)
      o->w[e * t->nr + r] =
          o->linear[(e - 1) * t->nr + r] + scalar(count, o->TI + ((e - 1) * t->nr + r) * width, o->g);
}

/* Solve for the joint forces at the nodes of a part of a regular step. */
static int solved(const March *t, Step *o, int64_t regime, int64_t step, double begin, double part) {
  const int status = tables(t, o, regime, step, begin, part);
  if (status) return status;
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nr = t->nr, ns = t->ns, nl = t->nl, m = t->m, width = wide(t);
  const double *k = t->k + o->regime * nf, *c = t->c + o->regime * nf;
  const double complex *RV = (const double complex *)t->RV + o->regime * nr * m;
  o->count = 0;
  for (int64_t l = 0; l < nl; l++)
    if (t->codes[l] == 3) o->dynamic[o->count++] = l;
  for (int64_t r = 0; r < ns; r++) o->w[r] = scalar(n, t->rows + r * n, t->x);
  memcpy(o->z, t->z, nl * sizeof(double));
  evaluate(t, o, 0);
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t r = 0; r < ns; r++) {
      double sum = 0.0;
      if (o->partial)
        for (int64_t i = 0; i < m; i++) sum += real_of(RV[r * m + i], o->begun[(e - 1) * m + i]);
      else
        sum = scalar(n, o->TR + ((e - 1) * nr + r) * n, t->x) +
              scalar(LOADS * nu, o->TI + ((e - 1) * nr + r) * width + NODES * nf, t->coefficients + step * LOADS * nu);
      o->linear[(e - 1) * nr + r] = sum;
    }
  for (int64_t e = 0; e < NODES; e++) {
    for (int64_t row = 0; row < nf; row++) o->g[e * nf + row] = o->f[row] - k[row] * o->w[row] - c[row] * o->w[nf + row];
    for (int64_t l = 0; l < nl; l++)
      o->z[e * nl + l] = t->z[l] + t->nodes[e] * o->h * (t->codes[l] == 3 ? o->law[l].rate : 0.0);
  }
  const int64_t nz = o->count, size = INNER * (nf + nz);
  double before = 0.0, before_z = 0.0;
  for (int turn = 0; turn < MAX_NEWTON; turn++) {
    fill_rows(t, o);
    double of_force = 0.0, of_rest = 0.0, of_z = 0.0, moved = 0.0, moved_z = 0.0;
    for (int64_t e = 0; e < NODES; e++) evaluate(t, o, e);
    for (int64_t e = 1; e < NODES; e++)
      for (int64_t row = 0; row < nf; row++)
        o->right[(e - 1) * nf + row] = o->f[e * nf + row] - k[row] * o->w[e * nr + row] -
                                       c[row] * o->w[e * nr + nf + row] - o->g[e * nf + row];
    for (int64_t i = 0; i < nz; i++)
      for (int64_t e = 1; e < NODES; e++) {
        const int64_t l = o->dynamic[i];
        double sum = t->z[l] - o->z[e * nl + l];
        for (int64_t j = 0; j < NODES; j++) sum += t->integrals[e * NODES + j] * o->h * o->law[j * nl + l].rate;
        o->right[INNER * nf + (e - 1) * nz + i] = sum;
      }
    jacobian(t, o);
    if (!factorise(size, o->J, o->pivots)) return TOO_LONG;
    solve(size, o->J, o->pivots, 1, o->right);
    for (int64_t e = 1; e < NODES; e++) {
      for (int64_t row = 0; row < nf; row++) {
        const double change = o->right[(e - 1) * nf + row];
        if (!isfinite(change)) return TOO_LONG;
        o->g[e * nf + row] += change;
        moved = fmax(moved, fabs(change));
      }
      for (int64_t i = 0; i < nz; i++) {
        const double change = o->right[INNER * nf + (e - 1) * nz + i];
        if (!isfinite(change)) return TOO_LONG;
        o->z[e * nl + o->dynamic[i]] += change;
        moved_z = fmax(moved_z, fabs(change));
      }
    }
    for (int64_t i = 0; i < NODES * nf; i++) of_force = fmax(of_force, fabs(o->f[i])), of_rest = fmax(of_rest, fabs(o->g[i]));
    for (int64_t i = 0; i < NODES * nl; i++) of_z = fmax(of_z, fabs(o->z[i]));
    /* The next change is smaller by as much as this one was, at least. */
    const double next = moved * fmin(1.0, moved / before), next_z = moved_z * fmin(1.0, moved_z / before_z);
    before = moved, before_z = moved_z;
    if (!(next > NEWTON_TOL * (of_force + of_rest) + 1e-300) && !(next_z > NEWTON_TOL * of_z + 1e-300)) {
      fill_rows(t, o);
      for (int64_t e = 0; e < NODES; e++) evaluate(t, o, e);
      return DONE;
    }
  }
  return TOO_LONG;
}

/* Solve the variational equation over a step, with the factors of Newton's last matrix. */
static void sensitivities(const March *t, Step *o) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nd = t->nd, nr = t->nr, nl = t->nl, q = t->q, p = t->p;
  const int64_t r = nd - nf - nu, ns = t->ns, w = ns - 2 * nf, nz = o->count, size = INNER * (nf + nz), m = t->m;
  const int64_t width = wide(t), beyond = further_at(t);
  const double *k = t->k + o->regime * nf, *c = t->c + o->regime * nf;
  const double complex *V = (const double complex *)t->V + o->regime * n * m;
  const double complex *iV = (const double complex *)t->iV + o->regime * m * n;
  const double complex *iVD = (const double complex *)t->iVD + o->regime * m * nd;
  const double complex *RV = (const double complex *)t->RV + o->regime * nr * m;
  double *re = o->Y, *im = re + m * q, *end_re = im + m * q, *end_im = end_re + m * q;
  double *W = o->W, *further = o->further, *G = o->G, *Z = o->Z, *direct = o->direct;
  memset(direct, 0, NODES * nf * q * sizeof(double));
  memset(further, 0, NODES * r * q * sizeof(double));
  for (int64_t e = 0; e < NODES; e++) {
    for (int64_t a = 0; a < p; a++)
      for (int64_t i = 0; i < r; i++) {
        double sum = scalar(w, t->by_rows + (a * r + i) * w, o->w + e * nr + 2 * nf);
        sum += scalar(nu, t->by_loads + (a * r + i) * nu, o->u + e * nu);
        further[(e * r + i) * q + a] = sum + scalar(nf, t->by_forces + (a * r + i) * nf, o->f + e * nf);
      }
    for (int64_t l = 0; l < nl; l++)
      for (int s = 0; s < SLOPES; s++) {
        const double slope = o->law[e * nl + l].p[s], *by = t->by_laws + (l * SLOPES + s) * p;
        if (slope != 0.0)
          for (int64_t a = 0; a < p; a++) direct[(e * nf + t->places[l]) * q + a] += slope * by[a];
      }
  }
  if (o->partial) {
    memset(re, 0, 2 * m * q * sizeof(double));
    for (int64_t i = 0; i < m; i++)
      for (int64_t s = 0; s < n; s++) {
        const double br = creal(iV[i * n + s]), bi = cimag(iV[i * n + s]);
        for (int64_t a = 0; a < q; a++) re[i * q + a] += br * t->S[s * q + a], im[i * q + a] += bi * t->S[s * q + a];
      }
  }
  for (int64_t e = 0; e < NODES; e++)
    for (int64_t i = 0; i < ns; i++) {
      double *line = W + (e * nr + i) * q;
      memset(line, 0, q * sizeof(double));
      if (e && o->partial) {
        for (int64_t s = 0; s < m; s++) {
          const double complex b = times(RV[i * m + s], o->E[(e - 1) * m + s]);
          for (int64_t a = 0; a < q; a++) line[a] += creal(b) * re[s * q + a] - cimag(b) * im[s * q + a];
        }
      } else {
        const double *by = e ? o->TR + ((e - 1) * nr + i) * n : t->rows + i * n;
        for (int64_t s = 0; s < n; s++)
          if (by[s] != 0.0)
            for (int64_t a = 0; a < q; a++) line[a] += by[s] * t->S[s * q + a];
      }
      if (e)
        for (int64_t j = 0; j < NODES * r; j++) {
          const double to = o->TI[((e - 1) * nr + i) * width + beyond + j];
          for (int64_t a = 0; a < p; a++) line[a] += to * further[j * q + a];
        }
    }
  for (int64_t row = 0; row < nf; row++) { /* the rest of the force at the beginning */
    const double by_d = o->fd[row] - k[row], by_v = o->fv[row] - c[row];
    for (int64_t a = 0; a < q; a++) G[row * q + a] = by_d * W[row * q + a] + by_v * W[(nf + row) * q + a] + direct[row * q + a];
  }
  for (int64_t l = 0; l < nl; l++)
    for (int64_t a = 0; a < q; a++)
      G[t->places[l] * q + a] += o->law[l].z * t->T[l * q + a] + t->began_slopes[l * q + a];
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t i = 0; i < ns; i++)
      for (int64_t f = 0; f < nf; f++) {
        const double to = o->TI[((e - 1) * nr + i) * width + f];
        for (int64_t a = 0; a < q; a++) W[(e * nr + i) * q + a] += to * G[f * q + a];
      }
  double *right = o->right;
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t row = 0; row < nf; row++) {
      const double by_d = o->fd[e * nf + row] - k[row], by_v = o->fv[e * nf + row] - c[row];
      const double *d = W + (e * nr + row) * q, *v = W + (e * nr + nf + row) * q, *own = direct + (e * nf + row) * q;
      for (int64_t a = 0; a < q; a++) right[((e - 1) * nf + row) * q + a] = by_d * d[a] + by_v * v[a] + own[a];
    }
  for (int64_t l = 0; l < nl; l++)
    if (t->codes[l] != 3)
      for (int64_t e = 1; e < NODES; e++)
        for (int64_t a = 0; a < q; a++)
          right[((e - 1) * nf + t->places[l]) * q + a] += o->law[e * nl + l].z * t->T[l * q + a] + t->began_slopes[l * q + a];
  for (int64_t i = 0; i < nz; i++) {
    const int64_t l = o->dynamic[i], row = t->places[l];
    for (int64_t j = 0; j < NODES; j++) { /* rates at the nodes */
      const Force *law = o->law + j * nl + l;
      double *rate = Z + j * q;
      for (int64_t a = 0; a < q; a++) {
        rate[a] = law->rd * W[(j * nr + row) * q + a] + law->rv * W[(j * nr + nf + row) * q + a];
        if (!j) rate[a] += law->rz * t->T[l * q + a];
      }
      for (int s = 0; s < SLOPES; s++)
        if (law->rp[s] != 0.0)
          for (int64_t a = 0; a < p; a++) rate[a] += law->rp[s] * t->by_laws[(l * SLOPES + s) * p + a];
    }
    for (int64_t e = 1; e < NODES; e++) {
      double *line = right + (INNER * nf + (e - 1) * nz + i) * q;
      memcpy(line, t->T + l * q, q * sizeof(double));
      for (int64_t j = 0; j < NODES; j++)
        for (int64_t a = 0; a < q; a++) line[a] += t->integrals[e * NODES + j] * o->h * Z[j * q + a];
    }
  }
  solve(size, o->J, o->pivots, q, right);
  memcpy(G + nf * q, right, INNER * nf * q * sizeof(double));
  if (o->partial)
    for (int64_t i = 0; i < m; i++) {
      const double complex E = o->E[(INNER - 1) * m + i];
      for (int64_t a = 0; a < q; a++) {
        end_re[i * q + a] = creal(E) * re[i * q + a] - cimag(E) * im[i * q + a];
        end_im[i * q + a] = creal(E) * im[i * q + a] + cimag(E) * re[i * q + a];
      }
      for (int64_t j = 0; j < NODES; j++) {
        const double complex weight = o->weights[((INNER - 1) * NODES + j) * m + i];
        for (int64_t f = 0; f < nf; f++) {
          const double complex b = times(weight, iVD[i * nd + f]);
          const double *from = G + (j * nf + f) * q;
          for (int64_t a = 0; a < q; a++) end_re[i * q + a] += creal(b) * from[a], end_im[i * q + a] += cimag(b) * from[a];
        }
        for (int64_t s = 0; s < r; s++) {
          const double complex b = times(weight, iVD[i * nd + nf + nu + s]);
          const double *from = further + (j * r + s) * q;
          for (int64_t a = 0; a < p; a++) end_re[i * q + a] += creal(b) * from[a], end_im[i * q + a] += cimag(b) * from[a];
        }
      }
    }
  for (int64_t i = 0; i < n; i++) {
    double *line = o->moved + i * q;
    memset(line, 0, q * sizeof(double));
    if (o->partial) {
      for (int64_t s = 0; s < m; s++) {
        const double br = creal(V[i * m + s]), bi = cimag(V[i * m + s]);
        for (int64_t a = 0; a < q; a++) line[a] += br * end_re[s * q + a] - bi * end_im[s * q + a];
      }
      continue;
    }
    const double *by = o->P + i * n, *to = o->Q + i * width;
    for (int64_t s = 0; s < n; s++)
      if (by[s] != 0.0)
        for (int64_t a = 0; a < q; a++) line[a] += by[s] * t->S[s * q + a];
    for (int64_t j = 0; j < NODES * nf; j++)
      for (int64_t a = 0; a < q; a++) line[a] += to[j] * G[j * q + a];
    for (int64_t j = 0; j < NODES * r; j++)
      for (int64_t a = 0; a < p; a++) line[a] += to[beyond + j] * further[j * q + a];
  }
  memcpy(t->S, o->moved, n * q * sizeof(double));
  for (int64_t i = 0; i < nz; i++)
    memcpy(t->T + o->dynamic[i] * q, right + (INNER * nf + (INNER - 1) * nz + i) * q, q * sizeof(double));
}

/* Add the work of the loads and what the dampers of the rest dissipate over a step; their rows are the last ones. */
static void add_energy(const March *t, Step *o, const double *loads) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nr = t->nr, m = t->m, width = wide(t);
  const double complex *RV = (const double complex *)t->RV + o->regime * nr * m;
  for (int64_t e = 0; e < NODES; e++)
    for (int64_t r = t->ns; r < nr; r++) {
      double w = 0.0;
      if (!e) {
        w = scalar(n, t->rows + r * n, t->x);
      } else if (o->partial) {
        for (int64_t i = 0; i < m; i++) w += real_of(RV[r * m + i], o->y[(e - 1) * m + i]);
      } else {
        const double *by = o->TI + ((e - 1) * nr + r) * width;
        w = scalar(n, o->TR + ((e - 1) * nr + r) * n, t->x) + scalar(NODES * nf, by, o->g);
        w += scalar(LOADS * nu, by + NODES * nf, loads);
      }
      const int64_t load = r - t->ns;
      const double weight = o->h * t->integrals[INNER * NODES + e];
      if (load < nu) t->work[nf] += weight * w * o->u[e * nu + load];
      else t->work[nf + 1] += weight * w * w;
    }
}

/* Add to the error of the state what polynomials leave out over a whole step; see `tables.left_out`. */
static void add_error(const March *t, Step *o, int64_t step) {
  const int64_t nf = t->nf, nu = t->nu, length = t->which[step];
  const double *beyond = t->beyond + (o->regime * t->lengths + length) * INNER * nf;
  double change = 0.0;
  for (int64_t i = 0; i < nu; i++) {
    const double *a = t->coefficients + (step + 1) * LOADS * nu + i, last = fabs(a[-nu]), before = fabs(a[-2 * nu]);
    change = fmax(change, o->h * (last < before ? last * last / before : last) * o->norms[i]);
  }
  for (int64_t i = 0; i < nf; i++) {
    double a[INNER] = {0.0};
    for (int k = 0; k < INNER; k++)
      for (int j = 0; j < NODES; j++) a[k] += t->legendre[k * NODES + j] * o->g[j * nf + i];
    const double head = sqrt(a[0] * a[0] + a[1] * a[1]), tail = sqrt(a[2] * a[2] + a[3] * a[3]);
    const double decay = tail < head ? tail / head : 1.0, root = sqrt(decay);
    double falling = tail * decay;
    for (int k = 0; k < INNER; k++, falling *= root) {
      double measured = 0.0;
      const double *both = t->two_steps + k * (2 * NODES - 1);
      for (int j = 0; j < NODES; j++) measured += both[j] * o->before[j * nf + i];
      for (int j = 1; j < NODES; j++) measured += both[INNER + j] * o->g[j * nf + i];
      change += beyond[k * nf + i] * (o->before_h == o->h ? fmin(falling, fabs(measured)) : falling);
    }
  }
  o->before_h = o->h;
  memcpy(o->before, o->g, NODES * nf * sizeof(double));
  t->work[nf + 2] = t->work[nf + 2] * t->fades[length] + change;
  t->work[nf + 3] = fmax(t->work[nf + 3], t->work[nf + 2]);
}

/* Go to the end of a step. */
static void accept(const March *t, Step *o, int64_t step) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nd = t->nd, m = t->m, width = wide(t);
  const double *loads = t->coefficients + step * LOADS * nu;
  if (t->q) { /* Newton's last matrix is that of the iterate before: at the solution it is made again */
    jacobian(t, o);
    factorise(INNER * (nf + o->count), o->J, o->pivots);
    sensitivities(t, o);
  }
  if (o->partial) {
    const double complex *V = (const double complex *)t->V + o->regime * n * m;
    const double complex *iVD = (const double complex *)t->iVD + o->regime * m * nd;
    for (int64_t e = t->nr > t->ns ? 0 : INNER - 1; e < INNER; e++)
      for (int64_t i = 0; i < m; i++) {
        double complex sum = o->begun[e * m + i];
        for (int64_t j = 0; j < NODES; j++) {
          double complex acting = 0.0;
          for (int64_t f = 0; f < nf; f++) acting += iVD[i * nd + f] * o->g[j * nf + f];
          sum += times(o->weights[(e * NODES + j) * m + i], acting);
        }
        o->y[e * m + i] = sum;
      }
    for (int64_t i = 0; i < n; i++) {
      double sum = 0.0;
      for (int64_t s = 0; s < m; s++) sum += real_of(V[i * m + s], o->y[(INNER - 1) * m + s]);
      o->next[i] = sum;
    }
  } else {
    for (int64_t i = 0; i < n; i++) {
      const double *to = o->Q + i * width;
      o->next[i] = scalar(n, o->P + i * n, t->x) + scalar(NODES * nf, to, o->g) + scalar(LOADS * nu, to + NODES * nf, loads);
    }
  }
  if (t->nr > t->ns) add_energy(t, o, loads);
  memcpy(t->x, o->next, n * sizeof(double));
  memcpy(t->z, o->z + INNER * t->nl, t->nl * sizeof(double));
  for (int64_t j = 0; j < NODES; j++)
    for (int64_t row = 0; row < nf; row++)
      t->work[row] += o->h * t->integrals[INNER * NODES + j] * o->f[j * nf + row] * o->w[j * t->nr + nf + row];
  t->at[2]++;
}

typedef struct {
  double theta;
  int64_t law;
  int number;
  Guard guard;
} Event;

/* A guard of a law on the polynomials through the nodes, with values `basis` of these. */
INLINE double guard_at(const March *t, const Step *o, int64_t l, int number, const double *basis, Guard *out) {
  Guard own[GUARDS];
  const int64_t row = t->places[l];
  double d = 0.0, v = 0.0, z = 0.0;
  for (int j = 0; j < NODES; j++) {
    d += basis[j] * o->w[j * t->nr + row];
    v += basis[j] * o->w[j * t->nr + t->nf + row];
    z += basis[j] * o->z[j * t->nl + l];
  }
  guards(t, l, t->state[l], d, v, z, own);
  if (out) *out = own[number];
  return own[number].value;
}

INLINE void basis_at(const March *t, double theta, double *basis) {
  for (int j = 0; j < NODES; j++) {
    double sum = 0.0;
    for (int k = NODES - 1; k >= 0; k--) sum = sum * theta + t->basis[j * NODES + k];
    basis[j] = sum;
  }
}

static double root(const March *t, const Step *o, int64_t l, int number, double low, double high) {
  double basis[NODES];
  basis_at(t, low, basis);
  double at_low = guard_at(t, o, l, number, basis, NULL);
  basis_at(t, high, basis);
  double at_high = guard_at(t, o, l, number, basis, NULL);
  if (at_low <= 0.0) return low;
  for (int turn = 0, side = 0; turn < 100 && high - low > EVENT_TOL; turn++) {
    const double apart = at_high - at_low;
    double theta = apart != 0.0 ? (low * at_high - high * at_low) / apart : low;
    if (!(low < theta && theta < high)) theta = (low + high) / 2.0;
    basis_at(t, theta, basis);
    const double value = guard_at(t, o, l, number, basis, NULL);
    if (value > 0.0) {
      if (side > 0) at_high /= 2.0;
      side = 1, low = theta, at_low = value;
    } else {
      if (side < 0) at_low /= 2.0;
      side = -1, high = theta, at_high = value;
    }
  }
  return high;
}

/* Find the earliest event of a step; 0 if there is none. */
static int first_event(const March *t, const Step *o, Event *event) {
  int any = 0;
  double last = 0.0;
  for (int64_t l = 0; l < t->nl; l++) {
    Guard own[GUARDS];
    const int64_t row = t->places[l], regime = t->state[l];
    const int count = guards(t, l, regime, 0.0, 0.0, 0.0, own);
    double size_d = fabs(t->offsets[l]), size_v = 0.0, size_z = 0.0;
    for (int j = 0; j < NODES && count; j++) {
      size_d = fmax(size_d, fabs(o->w[j * t->nr + row]));
      size_v = fmax(size_v, fabs(o->w[j * t->nr + t->nf + row]));
      size_z = fmax(size_z, fabs(o->z[j * t->nl + l]));
    }
    int located[GUARDS] = {0}, rises[GUARDS] = {0};
    double round_off[GUARDS] = {0.0};
    Guard second[GUARDS];
    guards(t, l, regime, o->w[t->nr + row], o->w[t->nr + t->nf + row], o->z[t->nl + l], second);
    guards(t, l, regime, o->w[row], o->w[t->nf + row], o->z[l], own);
    for (int number = 0; number < count; number++) { /* from 0 to the first node: positive, whatever polynomials say */
      const Guard *g = own + number;
      round_off[number] = GUARD_ROUND_OFF * (fabs(g->d) * size_d + fabs(g->v) * size_v + fabs(g->z) * size_z);
      rises[number] = g->value <= round_off[number] && second[number].value > round_off[number] && g->v == 0.0 &&
                      g->d * o->w[t->nf + row] + g->z * o->law[l].rate >= 0.0;
    }
    for (int64_t i = 0; i < t->scans && count && !(any && t->scan[i] > last); i++) {
      const double *basis = t->scan_basis + i * NODES;
      double d = 0.0, v = 0.0, z = 0.0;
      for (int j = 0; j < NODES; j++) {
        d += basis[j] * o->w[j * t->nr + row];
        v += basis[j] * o->w[j * t->nr + t->nf + row];
        z += basis[j] * o->z[j * t->nl + l];
      }
      guards(t, l, regime, d, v, z, own);
      for (int number = 0; number < count; number++) {
        const Guard *g = own + number;
        /* Without round-off a slider that just stuck would slip again. */
        if (located[number] || !(g->value < -round_off[number])) continue;
        if (rises[number] && t->scan[i] < t->nodes[1]) continue;
        located[number] = 1;
        const double low = i ? t->scan[i - 1] : 0.0;
        double theta = root(t, o, l, number, low, t->scan[i]), at_event[NODES];
        int earliest = number;
        basis_at(t, theta, at_event);
        for (int k = 0; k < count; k++) { /* negative there, though not at the scan: it was first */
          if (k == number || !(guard_at(t, o, l, k, at_event, NULL) < -round_off[k])) continue;
          if (rises[k] && theta < t->nodes[1]) continue;
          theta = root(t, o, l, k, low, theta), earliest = k;
        }
        if (!any || theta < event->theta) {
          event->theta = theta, event->law = l, event->number = earliest, last = t->scan[i];
          any = 1;
        }
      }
    }
  }
  return any;
}

/* Slopes of a function of a law's deflection, rate, hidden state and parameters (q). */
INLINE void slopes_of(const March *t, const Step *o, int64_t l, double d, double v, double z, const double *p, double *out) {
  const int64_t row = t->places[l], q = t->q;
  for (int64_t a = 0; a < q; a++)
    out[a] = d * o->W[row * q + a] + v * o->W[(t->nf + row) * q + a] + z * t->T[l * q + a];
  for (int s = 0; s < SLOPES; s++)
    if (p[s] != 0.0)
      for (int64_t a = 0; a < t->p; a++) out[a] += p[s] * t->by_laws[(l * SLOPES + s) * t->p + a];
}

/* Evaluate rows, their slopes and the laws at the state. */
static void at_state(const March *t, Step *o) {
  const int64_t n = t->n, q = t->q;
  for (int64_t r = 0; r < t->ns; r++) {
    const double *by = t->rows + r * n;
    double *line = o->W + r * q;
    o->w[r] = scalar(n, by, t->x);
    memset(line, 0, q * sizeof(double));
    for (int64_t s = 0; s < n; s++)
      if (by[s] != 0.0)
        for (int64_t a = 0; a < q; a++) line[a] += by[s] * t->S[s * q + a];
  }
  memcpy(o->z, t->z, t->nl * sizeof(double));
  evaluate(t, o, 0);
}

/* Open a loop of a law at a reversal, or close the last one: origins of branches with their slopes. */
static void remember(const March *t, const Step *o, int64_t l, int64_t following, double d, const Force *law) {
  const int64_t q = t->q, before = t->state[l];
  double *T = t->T + l * q, *F = t->began_slopes + l * q, *top = t->loops + 2 * t->memory * l;
  double *slopes = t->loop_slopes + 2 * q * t->memory * l;
  int64_t *open = t->open + l;
  if (!((following ^ before) & BACKWARDS)) {
    if (!(before & REVERSED)) return;
    *open = *open <= FIRST_LOOPS ? 0 : *open - 2;
    t->z[l] = top[2 * *open], t->began[l] = top[2 * *open + 1];
    memcpy(T, slopes + 2 * q * *open, q * sizeof(double)), memcpy(F, slopes + 2 * q * *open + q, q * sizeof(double));
    return;
  }
  if ((before & (SLIPPED | REVERSED)) == SLIPPED) { /* from where first loading would have come */
    double by[SLOPES] = {0.0};
    const double sign = sign_of(before), phi = all_slip(t->values + VALUES * l, by);
    for (int k = 0; k < VALUES; k++) by[k] *= -sign;
    slopes_of(t, o, l, 1.0, 0.0, 0.0, by, T);
    t->z[l] = d - sign * phi;
  }
  double *reversal = o->moved; /* slopes of its deflection, and of its force */
  const double none[SLOPES] = {0.0};
  slopes_of(t, o, l, 1.0, 0.0, 0.0, none, reversal);
  top += 2 * *open, slopes += 2 * q * *open;
  top[0] = t->z[l], top[1] = t->began[l];
  memcpy(slopes, T, q * sizeof(double)), memcpy(slopes + q, F, q * sizeof(double));
  if (!(before & REVERSED)) { /* the mirror image of the branch */
    top[2] = 2.0 * t->z[l] - d, top[3] = 0.0;
    for (int64_t a = 0; a < q; a++) slopes[2 * q + a] = 2.0 * T[a] - reversal[a], slopes[3 * q + a] = 0.0;
    ++*open;
  }
  ++*open;
  double *of_force = o->Z + 2 * q;
  slopes_of(t, o, l, law->d, law->v, law->z, law->p, of_force);
  for (int64_t a = 0; a < q; a++) F[a] += of_force[a];
  memcpy(T, reversal, q * sizeof(double));
  t->z[l] = d, t->began[l] = law->f;
}

/* Change the regime of a law, with hidden states and sensitivities. */
static void switched(const March *t, Step *o, const Event *event, int64_t step, double theta) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nd = t->nd, q = t->q, l = event->law, row = t->places[l];
  const int64_t before = t->state[l];
  double *f = o->linear, *shift = o->Z, *hidden = o->Z + q, size = 0.0, jump = 0.0;
  at_state(t, o);
  memcpy(f, o->f, nf * sizeof(double));
  const double d = o->w[row], v = o->w[nf + row], rate_z = o->law[l].rate;
  Guard own[GUARDS];
  guards(t, l, before, d, v, t->z[l], own);
  const Guard *g = own + event->number;
  loads_at(t, step, theta, o->u);
  double acceleration = scalar(n, t->rate_A + row * n, t->x) + scalar(nf, t->rate_D + row * nd, f);
  acceleration += scalar(nu, t->rate_D + row * nd + nf, o->u);
  const double rate = g->d * v + g->v * acceleration + g->z * rate_z;
  slopes_of(t, o, l, g->d, g->v, g->z, g->p, shift);
  for (int64_t a = 0; a < q; a++) shift[a] = rate != 0.0 ? -shift[a] / rate : 0.0;
  const int enters = t->codes[l] == 2 && g->following == 0;
  if (enters) {
    const double kt = t->values[VALUES * l], fs = t->values[VALUES * l + 1];
    const double by[SLOPES] = {before * fs / (kt * kt), -before / kt};
    slopes_of(t, o, l, 1.0, 0.0, 0.0, by, hidden);
    for (int64_t a = 0; a < q; a++) hidden[a] += v * shift[a];
    t->z[l] = d - before * fs / kt;
  }
  if (t->codes[l] == IWAN) remember(t, o, l, g->following, d, o->law + l);
  t->state[l] = g->following;
  memcpy(o->z, t->z, t->nl * sizeof(double));
  evaluate(t, o, 0);
  for (int64_t i = 0; i < nf; i++) {
    jump = fmax(jump, fabs(f[i] - o->f[i]));
    size = fmax(size, fmax(fabs(f[i]), fabs(o->f[i])));
  }
  if (q && jump > 1e-9 * 2.0 * size)
    for (int64_t i = 0; i < n; i++) {
      double by = 0.0;
      for (int64_t k = 0; k < nf; k++) by += t->D[i * nd + k] * (f[k] - o->f[k]);
      for (int64_t a = 0; a < q; a++) t->S[i * q + a] += by * shift[a];
    }
  if (enters) memcpy(t->T + l * q, hidden, q * sizeof(double));
  t->at[1]++;
}

/* Go over a regular step, from event to event. */
static int advanced(const March *t, Step *o, int64_t step) {
  int status;
  for (int turn = 0; turn < MAX_EVENTS; turn++) {
    const double begin = t->done[0], part = 1.0 - begin;
    int64_t regime = place_of(t);
    if (regime < 0) return NEEDS_REGIME;
    for (int64_t l = 0; l < t->nl; l++)
      if (t->open[l] + 2 > t->memory) return NEEDS_MEMORY;
    if ((status = solved(t, o, regime, step, begin, part))) return status;
    Event event = {0};
    if (!first_event(t, o, &event)) {
      accept(t, o, step);
      if (begin == 0.0) add_error(t, o, step);
      t->done[0] = 0.0;
      return DONE;
    }
    double theta = event.theta, end = begin;
    if (theta > 0.0) {
      for (int place = 0; place < MAX_LOCATIONS; place++) {
        if ((status = solved(t, o, regime, step, begin, part * theta))) return status;
        double basis[NODES];
        basis_at(t, 1.0, basis);
        const double at_end = guard_at(t, o, event.law, event.number, basis, NULL);
        basis_at(t, 1.0 - 1e-4, basis);
        const double slope = (at_end - guard_at(t, o, event.law, event.number, basis, NULL)) / 1e-4;
        const double correction = slope < 0.0 ? -at_end / slope : 0.0;
        if (fabs(correction) * theta < 1e-9 || !(0.5 < 1.0 + correction && 1.0 + correction < 2.0)) break;
        if (place < MAX_LOCATIONS - 1) theta = fmin(1.0, theta * (1.0 + correction));
      }
      accept(t, o, step);
      end += part * theta;
    }
    if (end >= 1.0 - EVENT_TOL) end = 1.0;
    switched(t, o, &event, step, end);
    t->done[0] = end == 1.0 ? 0.0 : end;
    if (end == 1.0) return DONE;
  }
  return TOO_LONG;
}

/* Keep the motion at a sample. */
static void keep(const March *t, Step *o, int64_t sample) {
  const int64_t n = t->n, nf = t->nf, nl = t->nl, q = t->q;
  at_state(t, o);
  memcpy(t->states + sample * n, t->x, n * sizeof(double));
  memcpy(t->hidden + sample * nl, t->z, nl * sizeof(double));
  memcpy(t->forces + sample * nf, o->f, nf * sizeof(double));
  memcpy(t->works + sample * (nf + 2), t->work, (nf + 2) * sizeof(double));
  memcpy(t->regime_of + sample * nl, t->state, nl * sizeof(int64_t));
  memcpy(t->slopes + sample * n * q, t->S, n * q * sizeof(double));
  memcpy(t->hidden_slopes + sample * nl * q, t->T, nl * q * sizeof(double));
  double *out = t->force_slopes + sample * nf * q;
  memset(out, 0, nf * q * sizeof(double));
  for (int64_t l = 0; l < nl && q; l++) {
    const Force *law = o->law + l;
    slopes_of(t, o, l, law->d, law->v, law->z, law->p, o->Z);
    for (int64_t a = 0; a < q; a++) out[t->places[l] * q + a] += o->Z[a] + t->began_slopes[l * q + a];
  }
}

/* March until the last sample, or until a regime is needed; see the statuses above. */
ENTRY int64_t dynid_march(const March *t) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nd = t->nd, nr = t->nr, nl = t->nl, q = t->q, m = t->m;
  const int64_t r = nd - nf - nu, size = INNER * (nf + nl), right = size * (q > 1 ? q : 1);
  const int64_t doubles = NODES * (nu + nr + nl + nf) + INNER * nr + nf + size * size + right + (2 * LOADS + 1) * nu + n * q + 3 * NODES * nf +
                          INNER * nr * wide(t) + n + NODES * nf + nu + NODES * nr * q + NODES * r * q + 2 * NODES * nf * q + NODES * q +
                          2 * q + 2 * m * INNER * (3 + NODES) + 4 * m * q;
  double *all = calloc(doubles + 64, sizeof(double)), *arena = all;
  int64_t *whole = calloc(size + nl + 1, sizeof(int64_t));
  Force *laws = calloc(NODES * nl + 1, sizeof(Force));
  int64_t status = DONE;
  if (!all || !whole || !laws) {
    free(all), free(whole), free(laws);
    return NO_MEMORY;
  }
#define ROOM(count) (arena += (count), arena - (count))
  Step o = {.law = laws, .pivots = whole, .dynamic = whole + size};
  o.E = (double complex *)ROOM(2 * m * INNER), o.weights = (double complex *)ROOM(2 * m * INNER * NODES);
  o.begun = (double complex *)ROOM(2 * m * INNER), o.y = (double complex *)ROOM(2 * m * INNER), o.Y = ROOM(4 * m * q);
  o.u = ROOM(NODES * nu), o.w = ROOM(NODES * nr), o.z = ROOM(NODES * nl), o.g = ROOM(NODES * nf);
  o.linear = ROOM(INNER * nr + nf), o.J = ROOM(size * size), o.right = ROOM(right), o.powers = ROOM((2 * LOADS + 1) * nu), o.moved = ROOM(n * q);
  o.f = ROOM(NODES * nf), o.fd = ROOM(NODES * nf), o.fv = ROOM(NODES * nf);
  o.own_TI = ROOM(INNER * nr * wide(t)), o.next = ROOM(n), o.norms = ROOM(nu), o.before = ROOM(NODES * nf);
  o.W = ROOM(NODES * nr * q), o.further = ROOM(NODES * r * q), o.direct = ROOM(NODES * nf * q);
  o.G = ROOM(NODES * nf * q), o.Z = ROOM(NODES * q + 2 * q);
#undef ROOM
  for (int64_t i = 0; i < nu; i++) {
    for (int64_t s = 0; s < n; s++) o.norms[i] += t->D[s * nd + nf + i] * t->D[s * nd + nf + i];
    o.norms[i] = sqrt(o.norms[i]);
  }
  for (; t->at[0] <= t->steps; t->at[0]++) {
    const int64_t step = t->at[0];
    if (t->done[0] == 0.0 && !t->at[3]) { /* at the beginning of a step, once */
      if (step == t->impulse)
        for (int64_t i = 0; i < n; i++) {
          t->work[nf] += (t->x[i] + t->jump[i] / 2.0) * t->jump_work[i];
          t->x[i] += t->jump[i];
        }
      if (t->sample[step] >= 0) keep(t, &o, t->sample[step]);
      t->at[3] = 1;
    }
    if (step == t->steps) break;
    if ((status = advanced(t, &o, step))) break;
    t->at[3] = 0;
  }
  free(all), free(whole), free(laws);
  return status;
}
