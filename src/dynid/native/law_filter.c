/* A pass of the filter where joints have nonlinear laws; see `dynid.identification.estimators.law_filter`. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "laws.h"
#include "products.h"

#define STAGES 4
static const double PART[STAGES] = {0.0, 0.5, 0.5, 1.0}, WEIGHT[STAGES] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
static const int LOAD_AT[STAGES] = {0, 1, 1, 2};

typedef struct {
  /* n states, h hidden ones, p parameters, nf joint forces, nu loads, nl laws, nc channels; steps of an interval */
  int64_t n, h, p, nf, nu, nl, nc, steps, first, last, samples, sigma_points;
  const double *A, *B, *E, *C, *T, *direct, *rows; /* each before its derivatives: 1 + p x … */
  const int64_t *codes, *places;
  const double *options, *values, *offsets, *by_laws;
  const int64_t *dynamic;
  const double *eta;
  const int64_t *log;
  const double *u, *dt; /* intervals x steps x 3 x nu; steps of the intervals */
  const int64_t *sample_of;
  const double *measured, *weight;
  double *z, *S; /* augmented state (N), a root of its covariance (N x N) */
  double *eta_history, *deviations, *states, *state_deviations, *innovations;
} Filter;

/* The equations of motion at coordinates; room for the evaluation of rates. */
typedef struct {
  double *growth, *here, *A, *B, *E, *C, *T, *values, *offsets, *statics;
  double *w, *f, *W, *F, *R; /* rows, forces, and slopes of both and of hidden rates */
} Local;

/* Add arrays of derivatives times numbers to the first one. */
static void combined(int64_t size, int64_t p, const double *array, const double *growth, double *out) {
  memcpy(out, array, size * sizeof(double));
  for (int64_t k = 0; k < p; k++)
    for (int64_t i = 0; i < size; i++) out[i] += growth[k] * array[(k + 1) * size + i];
}

static void localised(const Filter *t, Local *o, const double *eta) {
  const int64_t n = t->n, p = t->p, nf = t->nf;
  for (int64_t k = 0; k < p; k++) {
    const double left = eta[k] - t->eta[k];
    o->growth[k] = t->log[k] ? expm1(left) : left;
    o->here[k] = t->log[k] ? o->growth[k] + 1.0 : 1.0;
  }
  combined(n * n, p, t->A, o->growth, o->A);
  combined(n * t->nu, p, t->B, o->growth, o->B);
  combined(n * nf, p, t->E, o->growth, o->E);
  combined(t->nc * n, p, t->C, o->growth, o->C);
  combined(t->nc * nf, p, t->T, o->growth, o->T);
  for (int64_t l = 0; l < t->nl; l++) {
    for (int s = 0; s < SLOPES; s++) {
      double change = 0.0;
      for (int64_t k = 0; k < p; k++) change += t->by_laws[(l * SLOPES + s) * p + k] * o->growth[k];
      if (s < VALUES) o->values[l * VALUES + s] = t->values[l * VALUES + s] + change;
      if (s == SLOPES - 1) o->offsets[l] = t->offsets[l] + change;
    }
    double *statics = o->statics + (2 + VALUES) * l;
    const double *values = o->values + l * VALUES, *options = t->options + OPTIONS * l;
    memset(statics, 0, (2 + VALUES) * sizeof(double));
    if (o->offsets[l] == 0.0) continue;
    Force rest;
    const int64_t regime = law_regime(t->codes[l], values, options, o->offsets[l], 0.0, 0.0, 0.0);
    law_force(t->codes[l], values, statics, options, o->offsets[l], 0.0, regime, 0.0, 0.0, 0.0, &rest);
    statics[0] = rest.f, statics[1] = rest.d;
    for (int k = 0; k < VALUES; k++) statics[2 + k] = rest.p[k];
  }
}

/* Fill the joint forces at a state and rates of the hidden states; with q > 0 their slopes by the columns Y. */
static void forces(const Filter *t, Local *o, const double *y, const double *Y, int64_t q, double *rate) {
  const int64_t n = t->n, nf = t->nf, p = t->p;
  for (int64_t r = 0; r < 2 * nf; r++) {
    double sum = 0.0;
    for (int64_t i = 0; i < n; i++) sum += t->rows[r * n + i] * y[i];
    o->w[r] = sum;
    for (int64_t a = 0; a < q; a++) o->W[r * q + a] = 0.0;
    for (int64_t i = 0; i < n && q; i++)
      for (int64_t a = 0; a < q; a++) o->W[r * q + a] += t->rows[r * n + i] * Y[i * q + a];
  }
  memset(o->f, 0, nf * sizeof(double));
  memset(o->F, 0, nf * q * sizeof(double));
  memset(o->R, 0, t->h * q * sizeof(double));
  for (int64_t l = 0, hidden = 0; l < t->nl; l++) {
    const int64_t row = t->places[l], place = hidden < t->h && t->dynamic[hidden] == l ? hidden++ : -1;
    const double d = o->w[row], v = o->w[nf + row], z = place < 0 ? 0.0 : y[n + place];
    const double *values = o->values + VALUES * l, *options = t->options + OPTIONS * l;
    const int64_t regime = law_regime(t->codes[l], values, options, o->offsets[l], d, v, z);
    Force law;
    law_force(t->codes[l], values, o->statics + (2 + VALUES) * l, options, o->offsets[l], 0.0, regime, d, v, z, &law);
    o->f[row] += law.f;
    if (place >= 0) rate[place] = law.rate;
    if (!q) continue;
    for (int of_rate = 0; of_rate < (place < 0 ? 1 : 2); of_rate++) {
      double *out = of_rate ? o->R + place * q : o->F + row * q;
      const double by_d = of_rate ? law.rd : law.d, by_v = of_rate ? law.rv : law.v, by_z = of_rate ? law.rz : law.z;
      const double *by_p = of_rate ? law.rp : law.p;
      for (int64_t a = 0; a < q; a++) out[a] += by_d * o->W[row * q + a] + by_v * o->W[(nf + row) * q + a];
      for (int64_t a = 0; a < q && place >= 0; a++) out[a] += by_z * Y[(n + place) * q + a];
      for (int s = 0; s < SLOPES; s++)
        for (int64_t k = 0; k < p && by_p[s] != 0.0; k++)
          out[q - p + k] += by_p[s] * t->by_laws[(l * SLOPES + s) * p + k] * o->here[k];
    }
  }
}

/* Fill M x + N f + … and its slopes: of rows of a matrix at states and of one at forces, and of further terms. */
static void applied(const Filter *t, const Local *o, int64_t rows, const double *M, const double *N, const double *M_all,
                    const double *N_all, const double *y, const double *Y, int64_t q, double *out, double *slopes) {
  const int64_t n = t->n, nf = t->nf, p = t->p;
  for (int64_t r = 0; r < rows; r++) {
    double sum = 0.0;
    for (int64_t i = 0; i < n; i++) sum += M[r * n + i] * y[i];
    for (int64_t i = 0; i < nf; i++) sum += N[r * nf + i] * o->f[i];
    out[r] = sum;
    if (!q) continue;
    double *line = slopes + r * q;
    memset(line, 0, q * sizeof(double));
    for (int64_t i = 0; i < n; i++)
      for (int64_t a = 0; a < q; a++) line[a] += M[r * n + i] * Y[i * q + a];
    for (int64_t i = 0; i < nf; i++)
      for (int64_t a = 0; a < q; a++) line[a] += N[r * nf + i] * o->F[i * q + a];
    for (int64_t k = 0; k < p; k++) {
      double moved = 0.0;
      for (int64_t i = 0; i < n; i++) moved += M_all[((k + 1) * rows + r) * n + i] * y[i];
      for (int64_t i = 0; i < nf; i++) moved += N_all[((k + 1) * rows + r) * nf + i] * o->f[i];
      line[q - p + k] += moved * o->here[k];
    }
  }
}

static void rates(const Filter *t, Local *o, const double *y, const double *Y, int64_t q, const double *u, double *out,
                  double *slopes) {
  const int64_t n = t->n, nu = t->nu, p = t->p;
  forces(t, o, y, Y, q, out + n);
  applied(t, o, n, o->A, o->E, t->A, t->E, y, Y, q, out, slopes);
  for (int64_t i = 0; i < n; i++)
    for (int64_t j = 0; j < nu; j++) {
      out[i] += o->B[i * nu + j] * u[j];
      for (int64_t k = 0; k < p && q; k++)
        slopes[i * q + q - p + k] += t->B[((k + 1) * n + i) * nu + j] * u[j] * o->here[k];
    }
  if (q) memcpy(slopes + n * q, o->R, t->h * q * sizeof(double));
}

/* Integrate over an interval of the timeline (Runge and Kutta); `room`: 2 (m + m q) + STAGES (m + m q). */
static void propagated(const Filter *t, Local *o, double *y, double *Y, int64_t q, int64_t interval, double *room) {
  const int64_t m = t->n + t->h, size = m * (1 + q);
  double *at = room, *stage = room + size;
  const double h = t->dt[interval];
  for (int64_t step = 0; step < t->steps; step++) {
    const double *u = t->u + (interval * t->steps + step) * 3 * t->nu;
    for (int k = 0; k < STAGES; k++) {
      const double *before = stage + (k - 1) * size, by = PART[k] * h;
      for (int64_t i = 0; i < m; i++) at[i] = y[i] + (k ? by * before[i] : 0.0);
      for (int64_t i = 0; i < m * q; i++) at[m + i] = Y[i] + (k ? by * before[m + i] : 0.0);
      rates(t, o, at, at + m, q, u + LOAD_AT[k] * t->nu, stage + k * size, stage + k * size + m);
    }
    for (int k = 0; k < STAGES; k++) {
      for (int64_t i = 0; i < m; i++) y[i] += WEIGHT[k] * h * stage[k * size + i];
      for (int64_t i = 0; i < m * q; i++) Y[i] += WEIGHT[k] * h * stage[k * size + m + i];
    }
  }
}

static void outputs(const Filter *t, Local *o, const double *y, const double *Y, int64_t q, int64_t sample, double *out,
                    double *slopes) {
  const int64_t nc = t->nc, p = t->p;
  forces(t, o, y, Y, q, o->w + 2 * t->nf);
  applied(t, o, nc, o->C, o->T, t->C, t->T, y, Y, q, out, slopes);
  for (int64_t c = 0; c < nc; c++) {
    out[c] += t->direct[sample * nc + c];
    for (int64_t k = 0; k < p; k++) {
      const double by = t->direct[((k + 1) * t->samples + sample) * nc + c];
      out[c] += by * o->growth[k];
      if (q) slopes[c * q + q - p + k] += by * o->here[k];
    }
  }
}

/* Reflect a matrix (rows x columns, columns >= rows) from the right until it is lower triangular. */
static void triangular(int64_t rows, int64_t columns, double *M) {
  for (int64_t i = 0; i < rows; i++) {
    double *line = M + i * columns, square = 0.0, largest = 0.0;
    for (int64_t j = i; j < columns; j++) largest = fmax(largest, fabs(line[j]));
    if (!(largest > 0.0)) continue;
    for (int64_t j = i; j < columns; j++) square += (line[j] / largest) * (line[j] / largest);
    const double length = copysign(largest * sqrt(square), line[i]), head = line[i] + length;
    for (int64_t r = i + 1; r < rows; r++) {
      double *other = M + r * columns, sum = head * other[i];
      for (int64_t j = i + 1; j < columns; j++) sum += line[j] * other[j];
      const double share = sum / (length * head);
      other[i] -= share * head;
      for (int64_t j = i + 1; j < columns; j++) other[j] -= share * line[j];
    }
    line[i] = -length;
    for (int64_t j = i + 1; j < columns; j++) line[j] = 0.0;
  }
}

/* Filter nodes `first` … `last` - 1 of the timeline. */
ENTRY int64_t dynid_law_filter(const Filter *t) {
  const int64_t n = t->n, m = n + t->h, p = t->p, N = m + p, nf = t->nf, nc = t->nc, nl = t->nl, nu = t->nu;
  const int64_t q = t->sigma_points ? 0 : N, wide = t->sigma_points ? 2 * N : N, rows = nc + N, columns = wide + nc;
  const int64_t doubles = 2 * p + n * (n + nu + nf) + nc * (n + nf) + nl * (2 * VALUES + 3) + 2 * nf + m + nf + 3 * nf * N +
                          t->h * N + (1 + STAGES) * m * (1 + N) + rows * columns + wide * (m + nc) + m * N + nc * N + 3 * nc + 2 * N;
  double *all = calloc(doubles, sizeof(double)), *arena = all;
  if (!all) return NO_MEMORY;
#define ROOM(count) (arena += (count), arena - (count))
  Local o = {.growth = ROOM(p), .here = ROOM(p)};
  o.A = ROOM(n * n), o.B = ROOM(n * nu), o.E = ROOM(n * nf), o.C = ROOM(nc * n), o.T = ROOM(nc * nf);
  o.values = ROOM(nl * VALUES), o.offsets = ROOM(nl), o.statics = ROOM(nl * (2 + VALUES));
  o.w = ROOM(2 * nf + m), o.f = ROOM(nf), o.W = ROOM(2 * nf * N), o.F = ROOM(nf * N), o.R = ROOM(t->h * N);
  double *room = ROOM((1 + STAGES) * m * (1 + N)), *M = ROOM(rows * columns), *points = ROOM(wide * m), *outs = ROOM(wide * nc);
  double *Y = ROOM(m * N), *H = ROOM(nc * N), *out = ROOM(nc), *innovation = ROOM(nc), *point = ROOM(N), *mean = ROOM(N);
  int64_t *present = calloc(nc + 1, sizeof(int64_t));
#undef ROOM
  if (!present) {
    free(all);
    return NO_MEMORY;
  }
  double *z = t->z, *S = t->S;
  for (int64_t node = t->first; node < t->last; node++) {
    const int64_t sample = t->sample_of[node];
    int64_t k = 0;
    for (int64_t c = 0; c < nc && sample >= 0; c++)
      if (!isnan(t->measured[sample * nc + c])) present[k++] = c;
    const int64_t across = wide + k;
    memset(M, 0, (k + N) * across * sizeof(double));
    if (t->sigma_points) {
      const double scale = sqrt((double)N), share = 1.0 / (2.0 * N), weight = sqrt(share);
      memset(mean, 0, N * sizeof(double)), memset(out, 0, nc * sizeof(double));
      for (int64_t s = 0; s < wide; s++) {
        for (int64_t i = 0; i < N; i++) point[i] = z[i] + (s < N ? scale : -scale) * S[i * N + s % N];
        localised(t, &o, point + m);
        if (node) propagated(t, &o, point, NULL, 0, node - 1, room);
        if (sample >= 0) outputs(t, &o, point, NULL, 0, sample, outs + s * nc, NULL);
        memcpy(points + s * m, point, m * sizeof(double));
        for (int64_t i = 0; i < m; i++) mean[i] += share * point[i];
        for (int64_t c = 0; c < nc && sample >= 0; c++) out[c] += share * outs[s * nc + c];
        for (int64_t i = m; i < N; i++) M[(k + i) * across + s] = weight * (point[i] - z[i]);
      }
      for (int64_t s = 0; s < wide; s++) {
        for (int64_t i = 0; i < m; i++) M[(k + i) * across + s] = weight * (points[s * m + i] - mean[i]);
        for (int64_t c = 0; c < k; c++)
          M[c * across + s] = weight * (outs[s * nc + present[c]] - out[present[c]]) * t->weight[sample * nc + present[c]];
      }
      memcpy(z, mean, m * sizeof(double));
    } else {
      localised(t, &o, z + m);
      memset(Y, 0, m * N * sizeof(double));
      for (int64_t i = 0; i < m; i++) Y[i * N + i] = 1.0;
      if (node) propagated(t, &o, z, Y, q, node - 1, room);
      for (int64_t i = 0; i < N; i++) {
        double *line = M + (k + i) * across;
        if (i >= m) memcpy(line, S + i * N, N * sizeof(double));
        for (int64_t j = 0; j < N && i < m; j++)
          for (int64_t s = 0; s < N; s++) line[s] += Y[i * N + j] * S[j * N + s];
      }
      if (sample >= 0) {
        memset(Y, 0, m * N * sizeof(double));
        for (int64_t i = 0; i < m; i++) Y[i * N + i] = 1.0;
        outputs(t, &o, z, Y, q, sample, out, H);
        for (int64_t c = 0; c < k; c++)
          for (int64_t j = 0; j < N; j++)
            for (int64_t s = 0; s < N; s++)
              M[c * across + s] += t->weight[sample * nc + present[c]] * H[present[c] * N + j] * M[(k + j) * across + s];
      }
    }
    for (int64_t c = 0; c < k; c++) M[c * across + wide + c] = 1.0;
    triangular(k + N, across, M);
    for (int64_t c = 0; c < k; c++) { /* each given the channels before it */
      const double *line = M + c * across, weight = t->weight[sample * nc + present[c]];
      double left = (t->measured[sample * nc + present[c]] - out[present[c]]) * weight;
      for (int64_t j = 0; j < c; j++) left -= line[j] * innovation[j];
      innovation[c] = left / line[c];
      t->innovations[sample * nc + present[c]] = copysign(1.0, line[c]) * innovation[c];
    }
    for (int64_t i = 0; i < N; i++) {
      const double *line = M + (k + i) * across;
      for (int64_t c = 0; c < k; c++) z[i] += line[c] * innovation[c];
      memcpy(S + i * N, line + k, N * sizeof(double));
    }
    if (sample < 0) continue;
    for (int64_t i = 0; i < N; i++) {
      double square = 0.0;
      for (int64_t s = 0; s < N; s++) square += S[i * N + s] * S[i * N + s];
      const double deviation = sqrt(square);
      if (i < n) t->states[sample * n + i] = z[i], t->state_deviations[sample * n + i] = deviation;
      if (i >= m) t->eta_history[sample * p + i - m] = z[i], t->deviations[sample * p + i - m] = deviation;
    }
  }
  free(all), free(present);
  return 0;
}
