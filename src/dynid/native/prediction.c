/* Prediction of a record, its sensitivities and their triangular factors; see
 * `dynid.identification.systems.prediction` and `dynid.identification.least_squares.triangular_factors`. */
#include "orthogonal.h"
#include "steps.h"

/* Make the steps of all lengths ready; 1 of those that the series does not reach. */
ENTRY int64_t dynid_prepare(const Tables *t, const Linear *at, uint8_t *missed) {
  Work series = {0};
  if (!work(t, &series)) return NO_MEMORY;
  for (int64_t length = 0; length < t->lengths; length++) missed[length] = !linearise(t, length, at, &series);
  free(series.all);
  return 0;
}

/* Fill outputs from rest (samples x channels), and their derivatives by the first state (... x n). */
ENTRY int64_t dynid_free(const Tables *t, const Linear *at, int64_t channels, const double *C,
                         const double *direct, double *outputs, double *by_state) {
  const int64_t n = t->n, q = t->q, fed = n + q, beside = 1 + t->p, wide = at->wide, tall = at->tall;
  const int64_t width = padded(n), pitch = tall / n, rows = t->lengths * fed;
  double *all = calloc(padded(fed) + width + 2 * channels * width + rows * width, sizeof(double)), *arena = all;
  if (!all) return NO_MEMORY;
  double *driven = taken(&arena, fed), *moved = taken(&arena, width);
  double *read = taken(&arena, channels * width), *next = taken(&arena, channels * width);
  double *steps = taken(&arena, rows * width); /* the states of `forward`, without their derivatives */
  for (int64_t k = 0; k < rows; k++)
    for (int64_t i = 0; i < n; i++) steps[k * width + i] = at->forward[k * wide + i * beside];
  for (int64_t c = 0; c < channels; c++) memcpy(read + c * width, C + c * n, n * sizeof(double));
  for (int64_t node = 0; node < t->nodes; node++) {
    if (node > 0) {
      const int64_t length = t->which[node - 1];
      memcpy(driven + n, t->W + (node - 1) * q, q * sizeof(double));
      row_product(fed, width, driven, steps + length * fed * width, width, moved);
      memcpy(driven, moved, n * sizeof(double));
      product(channels, n, width, read, width, at->phis + length * beside * tall, pitch, next, width);
      double *swapped = read;
      read = next;
      next = swapped;
    }
    const int64_t sample = t->sample[node];
    if (sample < 0) continue;
    for (int64_t c = 0; c < channels; c++) {
      double sum = direct[sample * channels + c];
      for (int64_t i = 0; i < n; i++) sum += C[c * n + i] * driven[i];
      memcpy(by_state + (sample * channels + c) * n, read + c * width, n * sizeof(double));
      outputs[sample * channels + c] = sum;
    }
  }
  free(all);
  return 0;
}

/* Fill outputs from a first state, states (samples x n), and derivatives by the coordinates (... x p). */
ENTRY int64_t dynid_sensitive(const Tables *t, const Linear *at, int64_t channels, const double *C,
                              const double *C_slopes, const double *direct, const double *start,
                              double *outputs, double *states, double *by_parameter) {
  const int64_t n = t->n, p = t->p, q = t->q, fed = n + q, wide = at->wide, tall = at->tall;
  const int64_t width = padded(1 + p), pitch = tall / n;
  double *all = calloc(padded(fed) + wide + (2 * n + channels) * width, sizeof(double)), *arena = all;
  if (!all) return NO_MEMORY;
  double *driven = taken(&arena, fed), *moved = taken(&arena, wide);
  /* Beside the sensitivities a column of zeros, which the state itself takes when it is read. */
  double *slopes = taken(&arena, n * width), *ahead = taken(&arena, n * width);
  double *read = taken(&arena, channels * width);
  memcpy(driven, start, n * sizeof(double));
  for (int64_t node = 0; node < t->nodes; node++) {
    if (node > 0) {
      const int64_t length = t->which[node - 1];
      memcpy(driven + n, t->W + (node - 1) * q, q * sizeof(double));
      row_product(fed, wide, driven, at->forward + length * fed * wide, wide, moved);
      for (int64_t i = 0; i < n; i++) {
        driven[i] = moved[i * (1 + p)];
        slopes[i * width] = 0.0;
        for (int64_t j = 1; j <= p; j++) ahead[i * width + j] = moved[i * (1 + p) + j]; /* few: no call */
      }
      accumulate(n, n, width, at->phis + length * (1 + p) * tall, pitch, slopes, width, ahead, width);
      double *swapped = slopes;
      slopes = ahead;
      ahead = swapped;
    }
    const int64_t sample = t->sample[node];
    if (sample < 0) continue;
    for (int64_t i = 0; i < n; i++) slopes[i * width] = states[sample * n + i] = driven[i];
    product(channels, n, width, C, n, slopes, width, read, width);
    for (int64_t c = 0; c < channels; c++) {
      const int64_t place = sample * channels + c;
      outputs[place] = read[c * width] + direct[place];
      memcpy(by_parameter + place * p, read + c * width + 1, p * sizeof(double));
      if (C_slopes)
        for (int64_t j = 0; j < p; j++)
          for (int64_t i = 0; i < n; i++)
            by_parameter[place * p + j] += C_slopes[(j * channels + c) * n + i] * driven[i];
    }
  }
  free(all);
  return 0;
}

/* Set powers of two (columns) that bring the largest number of each column of rows near to one. */
INLINE void balance(int64_t rows, int64_t columns, int64_t pitch, const double *first, double *powers) {
  for (int64_t c = 0; c < columns; c++) powers[c] = 0.0;
  for (int64_t r = 0; r < rows; r++)
    for (int64_t c = 0; c < columns; c++) {
      const double size = fabs(first[r * pitch + c]);
      powers[c] = size > powers[c] ? size : powers[c]; /* no NaN is larger */
    }
  for (int64_t c = 0; c < columns; c++) {
    int exponent = 0;
    if (powers[c] > 0.0 && powers[c] < INFINITY) frexp(powers[c], &exponent);
    powers[c] = ldexp(1.0, exponent > 1000 ? 1000 : exponent < -1000 ? -1000 : exponent);
  }
}

/* Fill the triangular factors (channels x w x w, zero before) of derivatives by state (samples x channels x
 * n) and parameters (... x p) and residuals (samples x channels; NaN: missing), w = n + p + 1, over what each
 * channel is divided by; and count its residuals. Columns are reflected in powers of two of their own size,
 * so that no square overflows or vanishes. */
ENTRY int64_t dynid_triangles(int64_t samples, int64_t channels, int64_t n, int64_t p, const double *by_state,
                              const double *by_parameter, const double *residual, const double *rms,
                              double *out, int64_t *counts) {
  const int64_t w = n + p + 1;
  double *all = calloc(w * ROWS + 3 * padded(w), sizeof(double)), *block = all, *products = all + w * ROWS;
  double *powers = products + padded(w), *inverse = powers + padded(w);
  if (!all) return NO_MEMORY;
  for (int64_t channel = 0; channel < channels; channel++) {
    counts[channel] = 0;
    balance(samples, n, channels * n, by_state + channel * n, powers);
    balance(samples, p, channels * p, by_parameter + channel * p, powers + n);
    balance(samples, 1, channels, residual + channel, powers + n + p);
    for (int64_t c = 0; c < w; c++) inverse[c] = 1.0 / powers[c]; /* exact */
    for (int64_t first = 0; first < samples; first += ROWS) {
      memset(block, 0, w * ROWS * sizeof(double));
      for (int64_t r = 0; r < ROWS && first + r < samples; r++) {
        const int64_t place = (first + r) * channels + channel;
        if (isnan(residual[place])) continue;
        counts[channel]++;
        for (int64_t c = 0; c < n; c++) block[c * ROWS + r] = by_state[place * n + c] * inverse[c];
        for (int64_t c = 0; c < p; c++) block[(n + c) * ROWS + r] = by_parameter[place * p + c] * inverse[n + c];
        block[(n + p) * ROWS + r] = residual[place] * inverse[n + p];
      }
      reflect(out + channel * w * w, block, products, w);
    }
    for (int64_t r = 0; r < w; r++)
      for (int64_t c = r; c < w; c++) out[(channel * w + r) * w + c] *= powers[c] / rms[channel];
  }
  free(all);
  return 0;
}

#define UNREACHED 1
#define NOT_FINITE 2

/* A record as a fit reads it: n states. */
typedef struct {
  const double *values;        /* samples x channels; NaN: missing */
  const double *rms, *weights; /* channels: what rows are divided by, and multiplied with for the first state */
  const double *initial;       /* n: the given part of the first state */
  const double *root;          /* n x n: root of its prior covariance */
  double rank;                 /* singular values below this part of the largest are none */
} Fitted;

/* What a fit fills: first state (n), outputs and residuals (samples x channels), states (samples x n), derivatives
 * by the first state and by the coordinates (samples x channels x n, p), the triangular factors (channels x w x w, w
 * = n + p + 1) of derivatives and residuals, and the number of values of each channel. */
typedef struct {
  double *start, *outputs, *residual, *states, *by_state, *by_parameter, *factors;
  int64_t *counts;
} Fit;

/* Set the first state by the triangular factors (channels x n + 1 x n + 1) of derivatives by it and of values. */
INLINE int start_by(int64_t n, int64_t channels, const double *factors, const Fitted *r, double *start) {
  const int64_t w = n + 1, rows = channels * w;
  double *scaled = calloc(rows * w + n + 1, sizeof(double)), *shift = scaled + rows * w;
  if (!scaled) return 0;
  for (int64_t k = 0; k < rows; k++) {
    const double *row = factors + k * w, weight = r->weights[k / w];
    for (int64_t i = 0; i < n; i++)
      for (int64_t c = 0; c < n; c++) scaled[k * w + c] += weight * row[i] * r->root[i * n + c];
    scaled[k * w + n] = weight * row[n];
  }
  if (!least_squares(rows, n, scaled, r->rank, shift)) {
    free(scaled);
    return 0;
  }
  for (int64_t i = 0; i < n; i++) {
    start[i] = r->initial[i];
    for (int64_t c = 0; c < n; c++) start[i] += r->root[i * n + c] * shift[c];
  }
  free(scaled);
  return 1;
}

/* Fill the derivatives by the first state (samples x channels x n) and that state. */
INLINE int64_t begin(const Tables *t, const Linear *at, const Outputs *out, const double *C, const Fitted *r,
                     const Fit *fit) {
  const int64_t n = t->n, channels = out->channels, count = out->samples * channels, w = n + 1;
  double *factors = calloc(channels * w * w, sizeof(double));
  if (!factors) return NO_MEMORY;
  int64_t done = dynid_free(t, at, channels, C, out->direct, fit->residual, fit->by_state);
  for (int64_t k = 0; k < count; k++) {
    double given = 0.0;
    for (int64_t i = 0; i < n; i++) given += fit->by_state[k * n + i] * r->initial[i];
    fit->residual[k] = r->values[k] - (fit->residual[k] + given);
  }
  if (!done)
    done = dynid_triangles(out->samples, channels, n, 0, fit->by_state, fit->by_state, fit->residual, r->rms, factors,
                           fit->counts);
  int finite = 1;
  for (int64_t k = 0; k < channels * w * w; k++) finite &= isfinite(factors[k]) != 0;
  if (!done && !finite) done = NOT_FINITE;
  if (!done && !start_by(n, channels, factors, r, fit->start)) done = NO_MEMORY;
  free(factors);
  return done;
}

/* Fill the fit of a record with the steps `at` the coordinates, C and its slopes (absent: zero) there. */
INLINE int64_t fit_at(const Tables *t, const Linear *at, const Outputs *out, const double *C,
                      const double *C_slopes, const Fitted *r, const Fit *fit) {
  const int64_t p = t->p, channels = out->channels, count = out->samples * channels;
  int64_t done = begin(t, at, out, C, r, fit);
  if (done) return done;
  done = dynid_sensitive(t, at, channels, C, C_slopes, out->direct, fit->start, fit->outputs, fit->states,
                         fit->by_parameter);
  if (done) return done;
  for (int64_t k = 0; k < count; k++) fit->residual[k] = r->values[k] - fit->outputs[k];
  if (out->direct_slopes)
    for (int64_t j = 0; j < p; j++)
      for (int64_t k = 0; k < count; k++) fit->by_parameter[k * p + j] += out->direct_slopes[j * count + k];
  return dynid_triangles(out->samples, channels, t->n, p, fit->by_state, fit->by_parameter, fit->residual, r->rms,
                         fit->factors, fit->counts);
}

/* Fill the fit of a record at coordinates. Steps that are not given are made. Returns UNREACHED where the series
 * does not reach one, NOT_FINITE where derivatives by the first state are not finite. */
ENTRY int64_t dynid_fit(const Tables *t, const Linear *given, const double *eta, const Outputs *out, const Fitted *r,
                        const Fit *fit) {
  const int64_t n = t->n, p = t->p, size = out->channels * n, wide = padded(n * (1 + p)), tall = n * padded(n + p);
  const int64_t forward = given ? 0 : t->lengths * (n + t->q) * wide;
  const int64_t phis = given ? 0 : t->lengths * (1 + p) * tall;
  double *all = calloc(padded(forward) + padded(phis) + padded(p) + padded(t->lengths) + (1 + p) * padded(size) + 1,
                       sizeof(double)), *arena = all;
  if (!all) return NO_MEMORY;
  Linear own = {.wide = wide, .tall = tall};
  own.forward = taken(&arena, forward);
  own.phis = taken(&arena, phis);
  own.eta = taken(&arena, p);
  own.ready = (uint8_t *)taken(&arena, t->lengths);
  memcpy(own.eta, eta, p * sizeof(double));
  int64_t done = 0;
  if (!given) {
    Work series = {0};
    if (!work(t, &series)) done = NO_MEMORY;
    for (int64_t length = 0; !done && length < t->lengths; length++) done = linearise(t, length, &own, &series) ? 0 : UNREACHED;
    free(series.all);
  }
  const double *C = out->C, *C_slopes = out->C_slopes;
  if (out->affine && C_slopes) {
    double *sum = taken(&arena, size), *slopes = arena;
    memcpy(sum, C, size * sizeof(double));
    for (int64_t j = 0; j < p; j++)
      for (int64_t k = 0; k < size; k++) {
        slopes[j * size + k] = exp(eta[j]) * C_slopes[j * size + k];
        sum[k] += slopes[j * size + k];
      }
    C = sum;
    C_slopes = slopes;
  }
  if (!done) done = fit_at(t, given ? given : &own, out, C, C_slopes, r, fit);
  free(all);
  return done;
}

/* Set the shortest least-squares solution (columns) of rows [A, b] (rows x columns + 1). */
ENTRY int64_t dynid_least_squares(int64_t rows, int64_t columns, const double *both, double rank, double *x) {
  return least_squares(rows, columns, both, rank, x) ? 0 : NO_MEMORY;
}
