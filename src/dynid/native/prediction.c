/* Prediction of a record, its sensitivities and their triangular factors; see
 * `dynid.identification.prediction` and `dynid.identification.least_squares.triangular_factors`. */
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
        memcpy(ahead + i * width, moved + i * (1 + p), (1 + p) * sizeof(double));
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

#define ROWS 64 /* rows that are reflected at once */

/* Reflect the rows of a block (w x ROWS) into a triangle (w x w; Householder). */
INLINE void reflect(double *R, double *block, double *products, int64_t w) {
  for (int64_t j = 0; j < w; j++) {
    const double *pivot = block + j * ROWS;
    for (int64_t k = j; k < w; k++) products[k] = dot(ROWS, block + k * ROWS, pivot);
    const double square = products[j];
    if (square < 1e-280) continue; /* of columns near one: rounding of rounding, whose reciprocal overflows */
    const double diagonal = R[j * w + j], length = copysign(sqrt(diagonal * diagonal + square), diagonal);
    const double head = diagonal + length, share = 1.0 / (length * head);
    R[j * w + j] = -length;
    for (int64_t k = j + 1; k < w; k++) {
      const double scaled = -(head * R[j * w + k] + products[k]) * share;
      R[j * w + k] += scaled * head;
      for (int64_t c = 0; c < ROWS; c += WIDE)
        store(block + k * ROWS + c, load(block + k * ROWS + c) + scaled * load(pivot + c));
    }
  }
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

/* A record as a fit reads it: n states, p parameters. */
typedef struct {
  int64_t channels, samples;
  const double *C, *C_slopes;           /* channels x n; p x channels x n, absent where they vanish */
  const double *direct, *direct_slopes; /* samples x channels; p x samples x channels, or absent */
  const double *rms, *initial;          /* channels; n */
  const double *values;                 /* samples x channels; NaN: missing */
} Fitted;

/* Fill the derivatives by the first state (samples x channels x n), and the triangular factors (channels x
 * n + 1 x n + 1) of these and of what is left of the values by the given part of the first state. */
ENTRY int64_t dynid_begin_fit(const Tables *t, const Linear *at, const Fitted *r, double *by_state,
                              double *factors) {
  const int64_t n = t->n, count = r->samples * r->channels;
  double *residual = malloc((count + r->channels) * sizeof(double));
  if (!residual) return NO_MEMORY;
  int64_t done = dynid_free(t, at, r->channels, r->C, r->direct, residual, by_state);
  for (int64_t k = 0; k < count; k++) {
    double given = 0.0;
    for (int64_t i = 0; i < n; i++) given += by_state[k * n + i] * r->initial[i];
    residual[k] = r->values[k] - (residual[k] + given);
  }
  if (!done)
    done = dynid_triangles(r->samples, r->channels, n, 0, by_state, by_state, residual, r->rms, factors,
                           (int64_t *)(residual + count));
  free(residual);
  return done;
}

/* Fill outputs from a first state, states, derivatives by the coordinates, residuals, the triangular factors
 * (channels x w x w, w = n + p + 1) of derivatives and residuals, and the number of values of each channel. */
ENTRY int64_t dynid_end_fit(const Tables *t, const Linear *at, const Fitted *r, const double *start,
                            const double *by_state, double *outputs, double *states, double *by_parameter,
                            double *residual, double *factors, int64_t *counts) {
  const int64_t n = t->n, p = t->p, count = r->samples * r->channels;
  if (dynid_sensitive(t, at, r->channels, r->C, r->C_slopes, r->direct, start, outputs, states, by_parameter))
    return NO_MEMORY;
  for (int64_t k = 0; k < count; k++) residual[k] = r->values[k] - outputs[k];
  if (r->direct_slopes)
    for (int64_t j = 0; j < p; j++)
      for (int64_t k = 0; k < count; k++) by_parameter[k * p + j] += r->direct_slopes[j * count + k];
  return dynid_triangles(r->samples, r->channels, n, p, by_state, by_parameter, residual, r->rms, factors,
                         counts);
}
