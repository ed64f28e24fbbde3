/* The exact step and its derivatives at given parameters; see `dynid.identification.systems.kernels.steps`. */
#ifndef DYNID_STEPS_H
#define DYNID_STEPS_H

#include <math.h>
#include <stdlib.h>

#include "products.h"

/* The parts of a model that its steps need; n states, p parameters, q generator states, m = n / 2. */
typedef struct {
  int64_t n, p, rank, q, lengths, halvings, degrees, nodes;
  const double *lower;   /* m x n: lower half of A without the parameters */
  const double *left;    /* p x m x rank */
  const double *right;   /* p x rank x n */
  const double *rates;   /* m: diagonal of the upper right quarter of A */
  const double *h;       /* lengths of steps */
  const double *forcing; /* lengths x 1 + halvings x degrees x m x q: of the length, its half, its quarter ... */
  const double *turned;  /* lengths x 1 + halvings x q x q: the generator's exponentials */
  const double *reach;   /* lengths: norm of the generator times the step */
  const double *W;       /* nodes x q: generator states */
  const double *log;     /* p: 1 of logarithms, else 0 */
  const int64_t *which;  /* nodes - 1: the length of each step */
  const int64_t *sample; /* nodes: the sample at each node, or -1 */
} Tables;

/* The steps of all lengths about some coordinates, so far as they are ready. */
typedef struct {
  int64_t wide, tall;
  double *eta;     /* p */
  uint8_t *ready;  /* lengths */
  double *forward; /* lengths x n + q x wide */
  double *phis;    /* lengths x 1 + p x tall */
} Linear;

/* C (channels x n) and its slopes, and the direct term (samples x channels) with its slopes. Of an affine
 * model C is that without the parameters, and the slopes are by their values. */
typedef struct {
  int64_t affine, channels, samples;
  const double *C, *C_slopes, *direct, *direct_slopes; /* slopes: absent where they vanish */
} Outputs;

/* Room to sum a series in. */
typedef struct {
  int64_t block;
  double *values, *A, *scaled, *left, *touched, *one, *other, *all;
} Work;

#define REMAINDER 1e-15 /* the first omitted term of the series, over its sum */
#define REACH 4.0       /* norm of the longest step that the series takes */

/* Take numbers from an arena. */
INLINE double *taken(double **arena, int64_t count) {
  double *here = *arena;
  *arena += padded(count);
  return here;
}

/* Return 0 where there is no memory. */
INLINE int work(const Tables *t, Work *w) {
  const int64_t n = t->n, p = t->p, m = n / 2, block = padded(n + t->q), wide = (1 + p) * block;
  const int64_t most = padded(p) + 2 * padded(m * n) + padded(m * t->rank) + padded(p * t->rank * block) +
                       2 * padded(n * wide);
  double *arena = w->all = calloc(most, sizeof(double));
  w->block = block;
  if (!arena) return 0;
  w->values = taken(&arena, p);
  w->A = taken(&arena, m * n);
  w->scaled = taken(&arena, m * n);
  w->left = taken(&arena, m * t->rank);
  w->touched = taken(&arena, p * t->rank * block);
  w->one = taken(&arena, n * wide);
  w->other = taken(&arena, n * wide);
  return 1;
}

/* Return the degree of the Taylor polynomial of exp for a matrix of this norm. */
INLINE int64_t degree_of(double norm) {
  int64_t degree = 1;
  double term = norm * norm / 2;
  while (term > REMAINDER) term *= norm / (++degree + 1);
  return degree;
}

/* Set values and lower half of the system matrix; return the largest column sum of the whole. */
INLINE double norm_of(const Tables *t, const double *eta, Work *w) {
  const int64_t n = t->n, m = n / 2, rank = t->rank;
  memcpy(w->A, t->lower, m * n * sizeof(double));
  for (int64_t j = 0; j < t->p; j++) {
    w->values[j] = exp(eta[j]);
    for (int64_t i = 0; i < m; i++)
      for (int64_t r = 0; r < rank; r++) {
        const double share = w->values[j] * t->left[(j * m + i) * rank + r];
        for (int64_t k = 0; k < n; k++) w->A[i * n + k] += share * t->right[(j * rank + r) * n + k];
      }
  }
  double largest = 0.0;
  for (int64_t k = 0; k < n; k++) {
    double column = k >= m ? fabs(t->rates[k - m]) : 0.0;
    for (int64_t i = 0; i < m; i++) column += fabs(w->A[i * n + k]);
    if (!(column <= largest)) largest = column;
  }
  return largest;
}

/* Sum the series of [Phi, Gamma] and its derivatives (n x 1 + p x block) over a step h, by Horner's scheme;
 * `table` is its part of the forcing. */
INLINE double *summed(const Tables *t, double h, const double *table, int64_t degree, Work *w) {
  const int64_t n = t->n, m = n / 2, p = t->p, rank = t->rank, q = t->q, block = w->block;
  const int64_t wide = (1 + p) * block;
  double *old = w->one, *new = w->other;
  memset(old, 0, n * wide * sizeof(double));
  for (int64_t i = 0; i < n; i++) old[i * wide + i] = 1.0;
  for (int64_t k = degree; k > 0; k--) {
    const double share = h / k;
    for (int64_t i = 0; i < m * n; i++) w->scaled[i] = share * w->A[i];
    product(m, n, wide, w->scaled, n, old, wide, new + m * wide, wide);
    product(p * rank, n, block, t->right, n, old, wide, w->touched, block);
    for (int64_t j = 0; j < p; j++) {
      for (int64_t i = 0; i < m * rank; i++) w->left[i] = share * w->values[j] * t->left[j * m * rank + i];
      accumulate(m, rank, block, w->left, rank, w->touched + j * rank * block, block,
                 new + m * wide + (1 + j) * block, wide);
    }
    const double *forcing = table + (k - 1) * m * q;
    for (int64_t i = 0; i < m; i++) {
      const double rate = share * t->rates[i];
      for (int64_t c = 0; c < wide; c++) new[i * wide + c] = rate * old[(m + i) * wide + c];
      for (int64_t j = 0; j < q; j++) new[(m + i) * wide + n + j] += forcing[i * q + j];
    }
    for (int64_t i = 0; i < n; i++) new[i * wide + i] += 1.0;
    double *swapped = old;
    old = new;
    new = swapped;
  }
  return old;
}

/* Return the same over twice the step; `turned` is the generator's exponential over once. */
INLINE double *doubled(const Tables *t, const double *turned, double *old, Work *w) {
  const int64_t n = t->n, p = t->p, q = t->q, block = w->block, wide = (1 + p) * block;
  double *new = old == w->one ? w->other : w->one;
  for (int64_t j = 0; j <= p; j++) {
    double *to = new + j * block;
    const double *from = old + j * block;
    product(n, n, block, from, wide, old, wide, to, wide);
    if (j > 0) accumulate(n, n, block, old, wide, from, wide, to, wide);
    for (int64_t i = 0; i < n; i++)
      for (int64_t k = 0; k < q; k++)
        for (int64_t c = 0; c < q; c++) to[i * wide + n + c] += from[i * wide + n + k] * turned[k * q + c];
  }
  return new;
}

/* Compute the step of a length; return 0 where even a part of it is too long for the series. */
INLINE int linearise(const Tables *t, int64_t length, const Linear *at, Work *w) {
  if (!(t->reach[length] <= REACH * (1 << t->halvings))) return 0;
  double norm = t->h[length] * norm_of(t, at->eta, w), h = t->h[length];
  if (norm < t->reach[length]) norm = t->reach[length];
  int64_t halved = 0;
  for (; norm > REACH && halved < t->halvings; halved++) {
    norm /= 2;
    h /= 2;
  }
  if (!(norm <= REACH)) return 0;
  const int64_t n = t->n, q = t->q, beside = 1 + t->p, block = w->block, fed = n + q, pitch = at->tall / n;
  const int64_t part = length * (1 + t->halvings) + halved;
  double *sum = summed(t, h, t->forcing + part * t->degrees * (n / 2) * q, degree_of(norm) + 1, w);
  for (; halved > 0; halved--)
    sum = doubled(t, t->turned + (length * (1 + t->halvings) + halved) * q * q, sum, w);
  double *forward = at->forward + length * fed * at->wide, *phis = at->phis + length * beside * at->tall;
  for (int64_t i = 0; i < n; i++)
    for (int64_t j = 0; j < beside; j++) {
      const double *row = sum + (i * beside + j) * block;
      for (int64_t k = 0; k < fed; k++) forward[k * at->wide + i * beside + j] = row[k];
      for (int64_t k = 0; k < n; k++) phis[j * at->tall + i * pitch + k] = row[k];
    }
  at->ready[length] = 1;
  return 1;
}

#endif
