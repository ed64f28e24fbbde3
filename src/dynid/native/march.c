/* The march of a structure with nonlinear joints; see `dynid.structure.nonlinear.march`, whose steps these are. */
#include <complex.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "products.h"

#define NODES 5     /* Lobatto nodes of a step */
#define INNER 4     /* those with unknowns */
#define LOADS 9     /* coefficients of the loads of a step */
#define SLOPES 4    /* parameters of a law, its offset the last */
#define GUARDS 2
#define OPTIONS 6   /* numbers of a law that are no parameters: of a power the exponents, signs and kinks of d and v */
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

typedef struct {
  /* n states, nf joint forces, nu loads, nd directions, nr rows (of which ns are needed to solve a step, the others for
   * its energy), nl laws, q columns of slopes, p of parameters, m modes */
  int64_t n, nf, nu, nd, nr, ns, nl, q, p, m, steps, lengths, regimes, scans, impulse;
  const double *rows, *D, *rate_A, *rate_D; /* nr x n, n x nd; acceleration of the deflections: nf x n, nf x nd */
  const int64_t *codes, *places;            /* nl */
  const double *options, *values, *offsets, *statics; /* nl x OPTIONS, nl x 3, nl, nl x 5 */
  const double *by_laws, *by_rows, *by_loads, *by_forces;
  const double *h, *coefficients, *nodes, *basis, *integrals, *scan, *scan_basis, *load_basis, *legendre, *jump, *jump_work;
  const int64_t *which, *sample;
  /* Of each regime: folded stiffness and damping (nf); of each length tables, whose last axis is that of the forces at
   * all nodes, then of the loads there, then of further forces; modes (complex). */
  const double *k, *c, *P, *Q, *TR, *TI, *lam, *V, *iV, *iVD, *RV;
  const int64_t *diagonal;
  /* The state, with which a march goes on. */
  double *x, *z, *S, *T, *work, *done, *wanted; /* work: on the laws (nf), of loads, on dampers; sum of local errors of the state */
  int64_t *state, *at; /* regimes of the laws; step, events, steps taken, jumped */
  double *states, *hidden, *forces, *works, *slopes, *force_slopes, *hidden_slopes;
  int64_t *regime_of;
} March;

typedef struct {
  double f, d, v, z, rate, rd, rv, rz, p[SLOPES], rp[SLOPES];
} Force;

typedef struct {
  double value, d, v, z, p[SLOPES];
  int64_t following;
} Guard;

/* A step in room that is used again: nodes x … as in the march of NumPy. */
typedef struct {
  double h, *P, *Q, *TR, *TI; /* tables; of a part of a step TI alone, and its modes: */
  double complex *E, *weights, *y0, *y; /* INNER x m, INNER x NODES x m, m, INNER x m */
  double *Y; /* of slopes: real and imaginary parts at the beginning, and at the end (4 x m x q) */
  double *u, *w, *z, *g, *linear, *J, *right, *moved;
  Force *law; /* NODES x nl */
  double *f, *fd, *fv; /* NODES x nf: total force and slopes */
  int64_t *pivots, *dynamic, count;
  double *own_TI, *next, *norms; /* of the directions of forces and loads */
  double *W, *further, *direct, *G, *Z;
  int64_t regime;
  int partial;
} Step;

INLINE double power(double x, double exponent) {
  if (exponent == 0.0) return 1.0;
  if (exponent == 1.0) return x;
  if (exponent == 2.0) return x * x;
  if (exponent == 3.0) return x * x * x;
  return pow(x, exponent);
}

INLINE int kinked(const double *o, int which) { return o[4 + which] != 0.0; }
INLINE int whole(double exponent) { return exponent == (double)(int64_t)exponent; }

/* Clear a few numbers: a call, or a loop that a compiler makes one, takes longer than the law. */
INLINE void cleared(double *at, int count) {
  for (int k = 0; k < count; k += 4) {
    store(at + k, (Aligned){0});
    if (WIDE == 2) store(at + k + 2, (Aligned){0});
  }
}

/* A factor of a power law and its slope, continued smoothly beyond the regime. */
INLINE void factor(const double *o, int which, int64_t regime, double x, double *value, double *slope) {
  const double exponent = o[which];
  *value = 1.0;
  *slope = 0.0;
  if (exponent == 0.0) return;
  if (!kinked(o, which)) {
    *value = power(x, exponent);
    *slope = exponent * power(x, exponent - 1.0);
    return;
  }
  const double sign = regime >> which & 1 ? -1.0 : 1.0, odd = o[2 + which] != 0.0 ? sign : 1.0;
  double base = sign * x;
  if (base < 0.0 && !whole(exponent)) base = 0.0;
  *value = odd * power(base, exponent);
  *slope = odd * sign * exponent * power(base, exponent - 1.0);
}

INLINE void force(const March *t, int64_t l, int64_t r, double d, double v, double z, Force *o) {
  const double *p = t->values + 3 * l, *s = t->statics + 5 * l, *opt = t->options + OPTIONS * l;
  cleared((double *)o, sizeof *o / sizeof(double));
  const int64_t code = t->codes[l];
  const int shifted = code == 1 || code == 4;
  if (shifted) d += t->offsets[l];
  if (code == 1) {
    double a, da, b, db;
    factor(opt, 0, r, d, &a, &da);
    factor(opt, 1, r, v, &b, &db);
    o->f = p[0] * a * b, o->d = p[0] * da * b, o->v = p[0] * a * db, o->p[0] = a * b;
  } else if (code == 2) {
    if (r) {
      o->f = r * p[1], o->p[1] = r;
    } else {
      o->f = p[0] * (d - z), o->d = p[0], o->z = -p[0], o->p[0] = d - z;
    }
  } else if (code == 3) {
    o->f = p[0] * z, o->z = p[0], o->p[0] = z;
    const double sign = r & 2 ? -1.0 : 1.0, exponent = opt[0];
    double base = sign * z;
    if (base < 0.0 && !whole(exponent)) base = 0.0;
    const double raised = power(base, exponent), slope = sign * exponent * power(base, exponent - 1.0);
    const int loading = r == 0 || r == 3;
    const double change = loading ? -p[1] : p[2];
    o->rate = v * (1.0 + change * raised), o->rv = 1.0 + change * raised, o->rz = v * change * slope;
    o->rp[loading ? 1 : 2] = loading ? -v * raised : v * raised;
  } else if (code == 4 && r) {
    const double e = d - r * p[1];
    o->f = p[0] * e + p[2] * v, o->d = p[0], o->v = p[2];
    o->p[0] = e, o->p[1] = -r * p[0], o->p[2] = v;
  }
  if (shifted) {
    o->f -= s[0];
    for (int k = 0; k < 3; k++) o->p[k] -= s[2 + k];
    o->p[3] = o->d - s[1];
  }
}

/* Fill the guards of a regime; return their number. */
INLINE int guards(const March *t, int64_t l, int64_t r, double d, double v, double z, Guard *g) {
  const double *p = t->values + 3 * l, *opt = t->options + OPTIONS * l;
  int count = 0;
  for (int k = 0; k < GUARDS; k++) cleared((double *)(g + k), 8);
  if (t->codes[l] == 1) {
    const double x[2] = {d + t->offsets[l], v};
    for (int which = 0; which < 2; which++)
      if (kinked(opt, which)) {
        const double sign = r >> which & 1 ? -1.0 : 1.0;
        Guard *o = g + count++;
        o->value = sign * x[which], o->following = r ^ 1 << which;
        if (which) o->v = sign;
        else o->d = o->p[3] = sign;
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
    const double of_v = r & 1 ? -1.0 : 1.0, of_z = r & 2 ? -1.0 : 1.0;
    g[0].value = of_v * v, g[0].v = of_v, g[0].following = r ^ 1;
    g[1].value = of_z * z, g[1].z = of_z, g[1].following = r ^ 2;
    return 2;
  } else if (t->codes[l] == 4) {
    d += t->offsets[l];
    if (r) {
      g->value = r * d - p[1], g->d = g->p[3] = r, g->p[1] = -1.0, g->following = 0;
      return 1;
    }
    for (int s = 1; s >= -1; s -= 2)
      if (opt[s > 0 ? 0 : 1] != 0.0) {
        Guard *o = g + count++;
        o->value = p[1] - s * d, o->d = o->p[3] = -s, o->p[1] = 1.0, o->following = s;
      }
  }
  return count;
}

INLINE void tangent(const March *t, int64_t l, int64_t r, double *k, double *c) {
  const double *p = t->values + 3 * l, *o = t->options + OPTIONS * l;
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
  static const double factorial[] = {1.0, 1.0, 2.0, 6.0, 24.0, 120.0};
  static const double reciprocal[] = {1.0 / 5,  1.0 / 6,  1.0 / 7,  1.0 / 8,  1.0 / 9,  1.0 / 10, 1.0 / 11,
                                      1.0 / 12, 1.0 / 13, 1.0 / 14, 1.0 / 15, 1.0 / 16, 1.0 / 17, 1.0 / 18,
                                      1.0 / 19, 1.0 / 20, 1.0 / 21, 1.0 / 22, 1.0 / 23, 1.0 / 24};
  out[0] = cexp(z);
  const double size = creal(z) * creal(z) + cimag(z) * cimag(z);
  if (size > 1.0) {
    const double complex inverse = complex_of(creal(z) / size, -cimag(z) / size);
    for (int k = 0; k < NODES; k++) out[k + 1] = times(out[k] - 1.0 / factorial[k], inverse);
    return;
  }
  double complex term = 1.0 / factorial[NODES], last = term;
  for (int k = 1; k < 20; k++) {
    term = times(term, z) * reciprocal[k];
    last += term;
  }
  out[NODES] = last;
  for (int k = NODES - 1; k > 0; k--) out[k] = times(z, out[k + 1]) + 1.0 / factorial[k];
}

/* Point the step at the tables of a regular step, or make what a part of one needs by the modes. */
static int tables(const March *t, Step *o, int64_t regime, int64_t length, double h, int regular) {
  const int64_t n = t->n, nf = t->nf, nd = t->nd, nr = t->nr, ns = t->ns, m = t->m, at = regime * t->lengths + length;
  const int64_t groups[] = {0, nf, nf + t->nu, nd};
  o->regime = regime;
  o->h = h;
  o->partial = !regular;
  if (regular) {
    o->P = (double *)t->P + at * n * n, o->Q = (double *)t->Q + at * n * NODES * nd;
    o->TR = (double *)t->TR + at * INNER * nr * n, o->TI = (double *)t->TI + at * INNER * nr * NODES * nd;
    return DONE;
  }
  if (!t->diagonal[regime]) return NOT_DIAGONAL;
  o->TI = o->own_TI;
  const double complex *lam = (const double complex *)t->lam + regime * m;
  const double complex *iV = (const double complex *)t->iV + regime * m * n;
  const double complex *iVD = (const double complex *)t->iVD + regime * m * nd;
  const double complex *RV = (const double complex *)t->RV + regime * nr * m;
  static const double factorial[] = {1.0, 1.0, 2.0, 6.0, 24.0};
  for (int64_t i = 0; i < m; i++) {
    const double *right = (const double *)(iV + i * n);
    double re = 0.0, im = 0.0;
    for (int64_t s = 0; s < n; s++) re += right[2 * s] * t->x[s], im += right[2 * s + 1] * t->x[s];
    o->y0[i] = complex_of(re, im);
  }
  for (int e = 0; e < INNER; e++) {
    const double c = t->nodes[e + 1];
    double complex *weights = o->weights + e * NODES * m;
    double by[NODES][NODES], raised = h * c;
    for (int k = 0; k < NODES; k++, raised *= c)
      for (int j = 0; j < NODES; j++) by[j][k] = t->basis[j * NODES + k] * factorial[k] * raised;
    for (int64_t i = 0; i < m; i++) {
      double complex phi[NODES + 1];
      phi_functions(lam[i] * (h * c), phi);
      o->E[e * m + i] = phi[0];
      for (int j = 0; j < NODES; j++) {
        double re = 0.0, im = 0.0;
        for (int k = 0; k < NODES; k++) re += by[j][k] * creal(phi[k + 1]), im += by[j][k] * cimag(phi[k + 1]);
        weights[j * m + i] = complex_of(re, im);
      }
    }
    for (int64_t r = 0; r < ns; r++) {
      double *to_force = o->TI + (e * nr + r) * NODES * nd;
      for (int group = 0; group < 3; group++) {
        const int64_t first = groups[group], count = groups[group + 1] - first;
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
  }
  return DONE;
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
  const int64_t nf = t->nf, nd = t->nd, nr = t->nr, nl = t->nl, nz = o->count, size = INNER * (nf + nz);
  const double *k = t->k + o->regime * nf, *c = t->c + o->regime * nf;
  double *J = o->J;
  memset(J, 0, size * size * sizeof(double));
  for (int64_t i = 0; i < size; i++) J[i * size + i] = 1.0;
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t row = 0; row < nf; row++) {
      double *line = J + ((e - 1) * nf + row) * size;
      const double by_d = o->fd[e * nf + row] - k[row], by_v = o->fv[e * nf + row] - c[row];
      const double *d = o->TI + ((e - 1) * nr + row) * NODES * nd, *v = o->TI + ((e - 1) * nr + nf + row) * NODES * nd;
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
        const double *d = o->TI + ((j - 1) * nr + row) * NODES * nd, *v = o->TI + ((j - 1) * nr + nf + row) * NODES * nd;
        for (int64_t m = 0; m < INNER * nf; m++) line[m] -= a * (law->rd * d[nf + m] + law->rv * v[nf + m]);
        line[INNER * nf + (j - 1) * nz + i] -= a * law->rz;
      }
    }
  }
}

INLINE void fill_rows(const March *t, Step *o) {
  const int64_t count = NODES * t->nf;
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t r = 0; r < t->ns; r++)
      o->w[e * t->nr + r] =
          o->linear[(e - 1) * t->nr + r] + scalar(count, o->TI + ((e - 1) * t->nr + r) * NODES * t->nd, o->g);
}

/* Solve for the joint forces at the nodes, with loads from a part of a regular step on. */
static int solved(const March *t, Step *o, int64_t step, double begin, double part) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nr = t->nr, ns = t->ns, nl = t->nl, nd = t->nd, m = t->m;
  const double *k = t->k + o->regime * nf, *c = t->c + o->regime * nf;
  const double complex *RV = (const double complex *)t->RV + o->regime * nr * m;
  o->count = 0;
  for (int64_t l = 0; l < nl; l++)
    if (t->codes[l] == 3) o->dynamic[o->count++] = l;
  if (part == 1.0) { /* a whole step: the polynomials of the loads at the nodes are tabulated */
    memset(o->u, 0, NODES * nu * sizeof(double));
    for (int e = 0; e < NODES; e++)
      for (int i = 0; i < LOADS; i++)
        for (int64_t j = 0; j < nu; j++)
          o->u[e * nu + j] += t->load_basis[e * LOADS + i] * t->coefficients[(step * LOADS + i) * nu + j];
  } else {
    for (int64_t e = 0; e < NODES; e++) loads_at(t, step, begin + part * t->nodes[e], o->u + e * nu);
  }
  for (int64_t r = 0; r < ns; r++) o->w[r] = scalar(n, t->rows + r * n, t->x);
  memcpy(o->z, t->z, nl * sizeof(double));
  evaluate(t, o, 0);
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t r = 0; r < ns; r++) {
      double sum = 0.0;
      if (o->partial)
        for (int64_t i = 0; i < m; i++) sum += real_of(RV[r * m + i], times(o->E[(e - 1) * m + i], o->y0[i]));
      else
        sum = scalar(n, o->TR + ((e - 1) * nr + r) * n, t->x);
      sum += scalar(NODES * nu, o->TI + ((e - 1) * nr + r) * NODES * nd + NODES * nf, o->u);
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
          const double to = o->TI[((e - 1) * nr + i) * NODES * nd + NODES * (nf + nu) + j];
          for (int64_t a = 0; a < p; a++) line[a] += to * further[j * q + a];
        }
    }
  for (int64_t row = 0; row < nf; row++) { /* the rest of the force at the beginning */
    const double by_d = o->fd[row] - k[row], by_v = o->fv[row] - c[row];
    for (int64_t a = 0; a < q; a++) G[row * q + a] = by_d * W[row * q + a] + by_v * W[(nf + row) * q + a] + direct[row * q + a];
  }
  for (int64_t l = 0; l < nl; l++)
    for (int64_t a = 0; a < q; a++) G[t->places[l] * q + a] += o->law[l].z * t->T[l * q + a];
  for (int64_t e = 1; e < NODES; e++)
    for (int64_t i = 0; i < ns; i++)
      for (int64_t f = 0; f < nf; f++) {
        const double to = o->TI[((e - 1) * nr + i) * NODES * nd + f];
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
          right[((e - 1) * nf + t->places[l]) * q + a] += o->law[e * nl + l].z * t->T[l * q + a];
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
    const double *by = o->P + i * n, *to = o->Q + i * NODES * nd;
    for (int64_t s = 0; s < n; s++)
      if (by[s] != 0.0)
        for (int64_t a = 0; a < q; a++) line[a] += by[s] * t->S[s * q + a];
    for (int64_t j = 0; j < NODES * nf; j++)
      for (int64_t a = 0; a < q; a++) line[a] += to[j] * G[j * q + a];
    for (int64_t j = 0; j < NODES * r; j++)
      for (int64_t a = 0; a < p; a++) line[a] += to[NODES * (nf + nu) + j] * further[j * q + a];
  }
  memcpy(t->S, o->moved, n * q * sizeof(double));
  for (int64_t i = 0; i < nz; i++)
    memcpy(t->T + o->dynamic[i] * q, right + (INNER * nf + (INNER - 1) * nz + i) * q, q * sizeof(double));
}

/* Add the work of the loads and what the dampers of the rest dissipate over a step; their rows are the last ones. */
static void add_energy(const March *t, Step *o) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nd = t->nd, nr = t->nr, m = t->m;
  const double complex *RV = (const double complex *)t->RV + o->regime * nr * m;
  for (int64_t e = 0; e < NODES; e++)
    for (int64_t r = t->ns; r < nr; r++) {
      double w = 0.0;
      if (!e) {
        w = scalar(n, t->rows + r * n, t->x);
      } else if (o->partial) {
        for (int64_t i = 0; i < m; i++) w += real_of(RV[r * m + i], o->y[(e - 1) * m + i]);
      } else {
        const double *by = o->TI + ((e - 1) * nr + r) * NODES * nd;
        w = scalar(n, o->TR + ((e - 1) * nr + r) * n, t->x) + scalar(NODES * nf, by, o->g);
        w += scalar(NODES * nu, by + NODES * nf, o->u);
      }
      const int64_t load = r - t->ns;
      const double weight = o->h * t->integrals[INNER * NODES + e];
      if (load < nu) t->work[nf] += weight * w * o->u[e * nu + load];
      else t->work[nf + 1] += weight * w * w;
    }
}

/* Go to the end of a step. */
static void accept(const March *t, Step *o) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nd = t->nd, m = t->m;
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
        double complex sum = times(o->E[e * m + i], o->y0[i]);
        for (int64_t j = 0; j < NODES; j++) {
          double complex acting = 0.0;
          for (int64_t f = 0; f < nf; f++) acting += iVD[i * nd + f] * o->g[j * nf + f];
          for (int64_t k = 0; k < nu; k++) acting += iVD[i * nd + nf + k] * o->u[j * nu + k];
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
      const double *to = o->Q + i * NODES * nd;
      o->next[i] = scalar(n, o->P + i * n, t->x) + scalar(NODES * nf, to, o->g) + scalar(NODES * nu, to + NODES * nf, o->u);
    }
  }
  if (t->nr > t->ns) add_energy(t, o);
  double error = 0.0;
  for (int64_t i = 0; i < nf + nu; i++) { /* Legendre coefficients of degree 3 and 4 of what is interpolated */
    const double *values = i < nf ? o->g + i : o->u + (i - nf);
    const int64_t stride = i < nf ? nf : nu;
    double c3 = 0.0, c4 = 0.0;
    for (int j = 0; j < NODES; j++) c3 += t->legendre[j] * values[j * stride], c4 += t->legendre[NODES + j] * values[j * stride];
    const double decay = fabs(c4) < fabs(c3) ? c4 * c4 / (c3 * c3) : 1.0;
    error = fmax(error, fabs(c4) * decay * decay * o->norms[i]);
  }
  t->work[nf + 2] += o->h * error;
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
    int located[GUARDS] = {0};
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
        const double round_off = GUARD_ROUND_OFF * (fabs(g->d) * size_d + fabs(g->v) * size_v + fabs(g->z) * size_z);
        if (located[number] || !(g->value < -round_off)) continue; /* else a slider that just stuck would slip again */
        located[number] = 1;
        const double theta = root(t, o, l, number, i ? t->scan[i - 1] : 0.0, t->scan[i]);
        if (!any || theta < event->theta) {
          event->theta = theta, event->law = l, event->number = number, last = t->scan[i];
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
    const double kt = t->values[3 * l], fs = t->values[3 * l + 1];
    const double by[SLOPES] = {before * fs / (kt * kt), -before / kt, 0.0, 0.0};
    slopes_of(t, o, l, 1.0, 0.0, 0.0, by, hidden);
    for (int64_t a = 0; a < q; a++) hidden[a] += v * shift[a];
    t->z[l] = d - before * fs / kt;
  }
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
  const int64_t length = t->which[step];
  const double h = t->h[length];
  int status;
  for (int turn = 0; turn < MAX_EVENTS; turn++) {
    const double begin = t->done[0], part = 1.0 - begin;
    int64_t regime = place_of(t);
    if (regime < 0) return NEEDS_REGIME;
    if ((status = tables(t, o, regime, length, h * part, begin == 0.0))) return status;
    if ((status = solved(t, o, step, begin, part))) return status;
    Event event = {0};
    if (!first_event(t, o, &event)) {
      accept(t, o);
      t->done[0] = 0.0;
      return DONE;
    }
    double theta = event.theta, end = begin;
    if (theta > 0.0) {
      for (int place = 0; place < MAX_LOCATIONS; place++) {
        if ((status = tables(t, o, regime, length, h * part * theta, 0))) return status;
        if ((status = solved(t, o, step, begin, part * theta))) return status;
        double basis[NODES];
        basis_at(t, 1.0, basis);
        const double at_end = guard_at(t, o, event.law, event.number, basis, NULL);
        basis_at(t, 1.0 - 1e-4, basis);
        const double slope = (at_end - guard_at(t, o, event.law, event.number, basis, NULL)) / 1e-4;
        const double correction = slope < 0.0 ? -at_end / slope : 0.0;
        if (fabs(correction) * theta < 1e-9 || !(0.5 < 1.0 + correction && 1.0 + correction < 2.0)) break;
        if (place < MAX_LOCATIONS - 1) theta = fmin(1.0, theta * (1.0 + correction));
      }
      accept(t, o);
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
    for (int64_t a = 0; a < q; a++) out[t->places[l] * q + a] += o->Z[a];
  }
}

/* March until the last sample, or until a regime is needed; see the statuses above. */
ENTRY int64_t dynid_march(const March *t) {
  const int64_t n = t->n, nf = t->nf, nu = t->nu, nd = t->nd, nr = t->nr, nl = t->nl, q = t->q, m = t->m;
  const int64_t r = nd - nf - nu, size = INNER * (nf + nl), wide = q > 1 ? q : 1;
  const int64_t doubles = NODES * (nu + nr + nl + nf) + INNER * nr + nf + size * size + size * wide + n * q + 3 * NODES * nf +
                          INNER * nr * NODES * nd + n + nf + nu + NODES * nr * q + NODES * r * q + 2 * NODES * nf * q + NODES * q +
                          2 * q + 2 * m * (1 + INNER * (2 + NODES)) + 4 * m * q;
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
  o.y0 = (double complex *)ROOM(2 * m), o.y = (double complex *)ROOM(2 * m * INNER), o.Y = ROOM(4 * m * q);
  o.u = ROOM(NODES * nu), o.w = ROOM(NODES * nr), o.z = ROOM(NODES * nl), o.g = ROOM(NODES * nf);
  o.linear = ROOM(INNER * nr + nf), o.J = ROOM(size * size), o.right = ROOM(size * wide), o.moved = ROOM(n * q);
  o.f = ROOM(NODES * nf), o.fd = ROOM(NODES * nf), o.fv = ROOM(NODES * nf);
  o.own_TI = ROOM(INNER * nr * NODES * nd), o.next = ROOM(n), o.norms = ROOM(nf + nu);
  o.W = ROOM(NODES * nr * q), o.further = ROOM(NODES * r * q), o.direct = ROOM(NODES * nf * q);
  o.G = ROOM(NODES * nf * q), o.Z = ROOM(NODES * q + 2 * q);
#undef ROOM
  for (int64_t i = 0; i < nf + nu; i++) {
    for (int64_t s = 0; s < n; s++) o.norms[i] += t->D[s * nd + i] * t->D[s * nd + i];
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
