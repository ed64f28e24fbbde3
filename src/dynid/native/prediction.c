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

/* Outputs from a first state or from rest, and their derivatives by the first state, node by node. */
typedef struct {
  int64_t node;
  double *all, *driven, *moved, *read, *next, *steps;
} Response;

/* Return 0 where there is no memory; `start` (absent: rest) is the first state. */
INLINE int start_response(const Tables *t, const Linear *at, int64_t channels, const double *C, const double *start,
                          Response *r) {
  const int64_t n = t->n, fed = n + t->q, width = padded(n), rows = t->lengths * fed, beside = 1 + t->p;
  double *arena = r->all = calloc(padded(fed) + width + 2 * channels * width + rows * width, sizeof(double));
  if (!arena) return 0;
  r->node = 0;
  r->driven = taken(&arena, fed);
  r->moved = taken(&arena, width);
  r->read = taken(&arena, channels * width);
  r->next = taken(&arena, channels * width);
  r->steps = taken(&arena, rows * width); /* the states of `forward`, without their derivatives */
  for (int64_t k = 0; k < rows; k++)
    for (int64_t i = 0; i < n; i++) r->steps[k * width + i] = at->forward[k * at->wide + i * beside];
  for (int64_t c = 0; c < channels; c++) memcpy(r->read + c * width, C + c * n, n * sizeof(double));
  if (start) memcpy(r->driven, start, n * sizeof(double));
  return 1;
}

/* Fill outputs (count x channels) of the next samples, and their derivatives by the first state (... x n); either
 * may be absent. */
INLINE void respond(const Tables *t, const Linear *at, int64_t channels, const double *C, Response *r, int64_t count,
                    const double *direct, double *outputs, double *by_state) {
  const int64_t n = t->n, q = t->q, fed = n + q, width = padded(n), pitch = at->tall / n;
  for (int64_t done = 0; done < count && r->node < t->nodes; r->node++) {
    const int64_t node = r->node;
    if (node > 0) {
      const int64_t length = t->which[node - 1];
      memcpy(r->driven + n, t->W + (node - 1) * q, q * sizeof(double));
      if (outputs) {
        row_product(fed, width, r->driven, r->steps + length * fed * width, width, r->moved);
        memcpy(r->driven, r->moved, n * sizeof(double));
      }
      if (by_state) {
        product(channels, n, width, r->read, width, at->phis + length * (1 + t->p) * at->tall, pitch, r->next, width);
        double *swapped = r->read;
        r->read = r->next;
        r->next = swapped;
      }
    }
    if (t->sample[node] < 0) continue;
    for (int64_t c = 0; by_state && c < channels; c++)
      memcpy(by_state + (done * channels + c) * n, r->read + c * width, n * sizeof(double));
    for (int64_t c = 0; outputs && c < channels; c++) {
      double sum = direct[done * channels + c];
      for (int64_t i = 0; i < n; i++) sum += C[c * n + i] * r->driven[i];
      outputs[done * channels + c] = sum;
    }
    done++;
  }
}

/* Fill outputs of the next samples (count x channels), and their derivatives by the first state (... x n). `node`
 * nodes are done; `carried`: the state, zeros from rest, padded, and what the channels read of the first one. */
ENTRY int64_t dynid_free(const Tables *t, const Linear *at, int64_t channels, const double *C, int64_t *node,
                         double *carried, int64_t count, const double *direct, double *outputs, double *by_state) {
  const int64_t n = t->n, size = channels * padded(n);
  double *read = carried + padded(n);
  Response response;
  if (!start_response(t, at, channels, C, carried, &response)) return NO_MEMORY;
  response.node = *node;
  if (*node > 0) memcpy(response.read, read, size * sizeof(double));
  respond(t, at, channels, C, &response, count, direct, outputs, by_state);
  *node = response.node;
  memcpy(carried, response.driven, n * sizeof(double));
  memcpy(read, response.read, size * sizeof(double));
  free(response.all);
  return 0;
}

/* Outputs from a first state, and their derivatives by the coordinates, node by node. */
typedef struct {
  int64_t node;
  double *all, *driven, *moved, *slopes, *ahead, *read;
} Sensitivity;

/* Return 0 where there is no memory. */
INLINE int start_sensitivity(const Tables *t, const Linear *at, int64_t channels, const double *start,
                             Sensitivity *s) {
  const int64_t n = t->n, fed = n + t->q, width = padded(1 + t->p);
  double *arena = s->all = calloc(padded(fed) + at->wide + (2 * n + channels) * width, sizeof(double));
  if (!arena) return 0;
  s->node = 0;
  s->driven = taken(&arena, fed);
  s->moved = taken(&arena, at->wide);
  /* Beside the sensitivities a column of zeros, which the state itself takes when it is read. */
  s->slopes = taken(&arena, n * width);
  s->ahead = taken(&arena, n * width);
  s->read = taken(&arena, channels * width);
  memcpy(s->driven, start, n * sizeof(double));
  return 1;
}

/* Fill outputs (count x channels) and states (count x n) of the next samples, and derivatives by the coordinates
 * (... x p). */
INLINE void sense(const Tables *t, const Linear *at, int64_t channels, const double *C, const double *C_slopes,
                  Sensitivity *s, int64_t count, const double *direct, double *outputs, double *states,
                  double *by_parameter) {
  const int64_t n = t->n, p = t->p, q = t->q, fed = n + q, wide = at->wide, tall = at->tall;
  const int64_t width = padded(1 + p), pitch = tall / n;
  for (int64_t done = 0; done < count && s->node < t->nodes; s->node++) {
    const int64_t node = s->node;
    if (node > 0) {
      const int64_t length = t->which[node - 1];
      memcpy(s->driven + n, t->W + (node - 1) * q, q * sizeof(double));
      row_product(fed, wide, s->driven, at->forward + length * fed * wide, wide, s->moved);
      for (int64_t i = 0; i < n; i++) {
        s->driven[i] = s->moved[i * (1 + p)];
        s->slopes[i * width] = 0.0;
        for (int64_t j = 1; j <= p; j++) s->ahead[i * width + j] = s->moved[i * (1 + p) + j]; /* few: no call */
      }
      accumulate(n, n, width, at->phis + length * (1 + p) * tall, pitch, s->slopes, width, s->ahead, width);
      double *swapped = s->slopes;
      s->slopes = s->ahead;
      s->ahead = swapped;
    }
    if (t->sample[node] < 0) continue;
    for (int64_t i = 0; i < n; i++) s->slopes[i * width] = states[done * n + i] = s->driven[i];
    product(channels, n, width, C, n, s->slopes, width, s->read, width);
    for (int64_t c = 0; c < channels; c++) {
      const int64_t place = done * channels + c;
      outputs[place] = s->read[c * width] + direct[place];
      memcpy(by_parameter + place * p, s->read + c * width + 1, p * sizeof(double));
      if (C_slopes)
        for (int64_t j = 0; j < p; j++)
          for (int64_t i = 0; i < n; i++)
            by_parameter[place * p + j] += C_slopes[(j * channels + c) * n + i] * s->driven[i];
    }
    done++;
  }
}

/* Fill outputs of the next samples (count x channels), states (count x n), and derivatives of the outputs by the
 * coordinates (... x p). `node` nodes are done; `carried`: the state, padded, and its derivatives. */
ENTRY int64_t dynid_sensitive(const Tables *t, const Linear *at, int64_t channels, const double *C,
                              const double *C_slopes, int64_t *node, double *carried, int64_t count,
                              const double *direct, double *outputs, double *states, double *by_parameter) {
  const int64_t n = t->n, size = n * padded(1 + t->p);
  double *slopes = carried + padded(n);
  Sensitivity sensitivity;
  if (!start_sensitivity(t, at, channels, carried, &sensitivity)) return NO_MEMORY;
  sensitivity.node = *node;
  memcpy(sensitivity.slopes, slopes, size * sizeof(double));
  sense(t, at, channels, C, C_slopes, &sensitivity, count, direct, outputs, states, by_parameter);
  *node = sensitivity.node;
  memcpy(carried, sensitivity.driven, n * sizeof(double));
  memcpy(slopes, sensitivity.slopes, size * sizeof(double));
  free(sensitivity.all);
  return 0;
}

/* Let powers of two (columns) grow that bring the largest number of each column of rows near to one; the columns of
 * a triangle (w x w, from column `at` on) that is in units of them follow. */
INLINE void balance(int64_t rows, int64_t columns, int64_t pitch, const double *first, double *powers, double *R,
                    int64_t w, int64_t at, double *sizes) {
  for (int64_t c = 0; c < columns; c++) sizes[c] = 0.0;
  for (int64_t r = 0; r < rows; r++)
    for (int64_t c = 0; c < columns; c++) {
      const double size = fabs(first[r * pitch + c]);
      sizes[c] = size > sizes[c] ? size : sizes[c]; /* no NaN is larger */
    }
  for (int64_t c = 0; c < columns; c++) {
    int exponent = 0;
    if (!(sizes[c] > 0.0)) continue;
    if (sizes[c] < INFINITY) frexp(sizes[c], &exponent);
    const double power = ldexp(1.0, exponent > 1000 ? 1000 : exponent < -1000 ? -1000 : exponent);
    if (power <= powers[at + c]) continue;
    for (int64_t r = 0; powers[at + c] > 0.0 && r <= at + c; r++) R[r * w + at + c] *= powers[at + c] / power;
    powers[at + c] = power;
  }
}

#define BLOCK 256 /* samples whose derivatives are held at once, a multiple of ROWS */

/* Triangular factors (channels x w x w) in units of powers of two (channels x w), and what fills them. */
typedef struct {
  int64_t channels, n, p;
  double *R, *powers, *block, *products, *sizes, *all;
  int64_t *counts;
} Triangles;

/* Begin with zeros, or with triangles in units of `powers` (absent: zeros); return 0 where there is no memory. */
INLINE int start_triangles(int64_t channels, int64_t n, int64_t p, double *R, int64_t *counts, double *powers,
                           Triangles *to) {
  const int64_t w = n + p + 1;
  *to = (Triangles){.channels = channels, .n = n, .p = p, .R = R, .counts = counts};
  double *arena = to->all = calloc(w * ROWS + 2 * padded(w) + channels * w, sizeof(double));
  if (!arena) return 0;
  to->block = taken(&arena, w * ROWS);
  to->products = taken(&arena, w);
  to->sizes = taken(&arena, w);
  to->powers = powers ? powers : arena;
  if (powers) return 1;
  memset(R, 0, channels * w * w * sizeof(double));
  memset(counts, 0, channels * sizeof(int64_t));
  return 1;
}

/* Reflect derivatives by state (samples x channels x n) and parameters (... x p) and residuals (samples x channels;
 * NaN: missing) of the next samples. Columns are in powers of two of their own size, so that no square overflows or
 * vanishes. */
INLINE void absorb(const Triangles *to, int64_t samples, const double *by_state, const double *by_parameter,
                   const double *residual) {
  const int64_t channels = to->channels, n = to->n, p = to->p, w = n + p + 1;
  double *block = to->block;
  for (int64_t channel = 0; channel < channels; channel++) {
    double *R = to->R + channel * w * w, *powers = to->powers + channel * w;
    balance(samples, n, channels * n, by_state + channel * n, powers, R, w, 0, to->sizes);
    balance(samples, p, channels * p, by_parameter + channel * p, powers, R, w, n, to->sizes);
    balance(samples, 1, channels, residual + channel, powers, R, w, n + p, to->sizes);
    for (int64_t c = 0; c < w; c++) to->sizes[c] = powers[c] > 0.0 ? 1.0 / powers[c] : 1.0; /* exact */
    for (int64_t first = 0; first < samples; first += ROWS) {
      memset(block, 0, w * ROWS * sizeof(double));
      for (int64_t r = 0; r < ROWS && first + r < samples; r++) {
        const int64_t place = (first + r) * channels + channel;
        if (isnan(residual[place])) continue;
        to->counts[channel]++;
        for (int64_t c = 0; c < n; c++) block[c * ROWS + r] = by_state[place * n + c] * to->sizes[c];
        for (int64_t c = 0; c < p; c++) block[(n + c) * ROWS + r] = by_parameter[place * p + c] * to->sizes[n + c];
        block[(n + p) * ROWS + r] = residual[place] * to->sizes[n + p];
      }
      reflect(R, block, to->products, w);
    }
  }
}

/* Bring the triangles to units of what each channel is divided by. */
INLINE void end_triangles(const Triangles *to, const double *rms) {
  const int64_t w = to->n + to->p + 1;
  for (int64_t channel = 0; channel < to->channels; channel++)
    for (int64_t r = 0; r < w; r++)
      for (int64_t c = r; c < w; c++)
        if (to->powers[channel * w + c] > 0.0) to->R[(channel * w + r) * w + c] *= to->powers[channel * w + c] / rms[channel];
  free(to->all);
}

/* Reflect derivatives by state (samples x channels x n) and parameters (... x p) and residuals (samples x channels;
 * NaN: missing) into triangular factors (channels x w x w, w = n + p + 1) in units of `powers` (channels x w), all zeros
 * before the first samples; and add to the counts of residuals. */
ENTRY int64_t dynid_triangles(int64_t samples, int64_t channels, int64_t n, int64_t p, const double *by_state,
                              const double *by_parameter, const double *residual, double *powers, double *out,
                              int64_t *counts) {
  Triangles to;
  if (!start_triangles(channels, n, p, out, counts, powers, &to)) return NO_MEMORY;
  for (int64_t first = 0; first < samples; first += BLOCK) {
    const int64_t count = samples - first < BLOCK ? samples - first : BLOCK, place = first * channels;
    absorb(&to, count, by_state + place * n, by_parameter + place * p, residual + place);
  }
  free(to.all);
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

/* What a fit fills: first state (n), outputs and residuals (samples x channels); unless it is for the residuals alone
 * (`factors` absent), states (samples x n), the triangular factors (channels x w x w, w = n + p + 1) of derivatives
 * by the first state and by the coordinates and of residuals, and the number of values of each channel. The
 * derivatives (samples x channels x n, p) are absent where they are not kept. */
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

/* Set the RMS of what is left of values (channels) from a first state, by factors as of `start_by`. */
INLINE void sizes_from(int64_t n, int64_t channels, const double *factors, const int64_t *counts, const Fitted *r,
                       const double *start, double *sizes) {
  const int64_t w = n + 1;
  for (int64_t c = 0; c < channels; c++) {
    double squares = 0.0;
    for (int64_t k = 0; k < w; k++) {
      const double *row = factors + (c * w + k) * w;
      double left = row[n];
      for (int64_t i = 0; i < n; i++) left -= row[i] * (start[i] - r->initial[i]);
      squares += left * left;
    }
    sizes[c] = sqrt(squares / (double)counts[c]) * r->rms[c];
  }
}

/* Fill the first state, and the derivatives by it where they are kept; `by_state`: room for a block of them. With
 * `sizes` (channels), the RMS of the residuals, no residuals are filled; the room for them is after the derivatives. */
INLINE int64_t begin(const Tables *t, const Linear *at, const Outputs *out, const double *C, const Fitted *r,
                     const Fit *fit, double *by_state, double *sizes) {
  const int64_t n = t->n, channels = out->channels, w = n + 1;
  double *factors = calloc(channels * (w * w + 1), sizeof(double));
  Response response = {0};
  Triangles to = {0};
  if (!factors || !start_response(t, at, channels, C, NULL, &response) ||
      !start_triangles(channels, n, 0, factors, (int64_t *)(factors + channels * w * w), NULL, &to)) {
    free(factors);
    free(response.all);
    return NO_MEMORY;
  }
  for (int64_t first = 0; first < out->samples; first += BLOCK) {
    const int64_t count = out->samples - first < BLOCK ? out->samples - first : BLOCK, place = first * channels;
    double *rows = fit->by_state ? fit->by_state + place * n : by_state;
    double *left = sizes ? by_state + BLOCK * channels * n : fit->residual + place;
    respond(t, at, channels, C, &response, count, out->direct + place, left, rows);
    for (int64_t k = 0; k < count * channels; k++) {
      double given = 0.0;
      for (int64_t i = 0; i < n; i++) given += rows[k * n + i] * r->initial[i];
      left[k] = r->values[place + k] - (left[k] + given);
    }
    absorb(&to, count, rows, rows, left);
  }
  end_triangles(&to, r->rms);
  free(response.all);
  int finite = 1;
  for (int64_t k = 0; k < channels * w * w; k++) finite &= isfinite(factors[k]) != 0;
  const int64_t done = !finite ? NOT_FINITE : start_by(n, channels, factors, r, fit->start) ? 0 : NO_MEMORY;
  if (sizes && !done) sizes_from(n, channels, factors, to.counts, r, fit->start, sizes);
  free(factors);
  return done;
}

/* Fill the fit of a record with the steps `at` the coordinates, C and its slopes (absent: zero) there, block by block:
 * memory does not grow with the record beyond what is kept. */
INLINE int64_t fit_at(const Tables *t, const Linear *at, const Outputs *out, const double *C,
                      const double *C_slopes, const Fitted *r, const Fit *fit) {
  const int64_t n = t->n, p = t->p, channels = out->channels, all = out->samples * channels;
  double *room = malloc(BLOCK * channels * (n + p) * sizeof(double)), *slopes_room = room + BLOCK * channels * n;
  if (!room) return NO_MEMORY;
  int64_t done = begin(t, at, out, C, r, fit, room, NULL);
  Response response = {0};
  Sensitivity sensitivity = {0};
  Triangles to = {0};
  const int sensitive = fit->factors != NULL;
  if (!done && (!start_response(t, at, channels, C, fit->start, &response) ||
                (sensitive && (!start_sensitivity(t, at, channels, fit->start, &sensitivity) ||
                               !start_triangles(channels, n, p, fit->factors, fit->counts, NULL, &to)))))
    done = NO_MEMORY;
  for (int64_t first = 0; !done && first < out->samples; first += BLOCK) {
    const int64_t count = out->samples - first < BLOCK ? out->samples - first : BLOCK, place = first * channels;
    const double *direct = out->direct + place;
    double *rows = fit->by_state ? fit->by_state + place * n : room, *outputs = fit->outputs + place;
    double *slopes = fit->by_parameter ? fit->by_parameter + place * p : slopes_room;
    if (!sensitive)
      respond(t, at, channels, C, &response, count, direct, outputs, NULL);
    else {
      if (!fit->by_state) respond(t, at, channels, C, &response, count, direct, NULL, rows);
      sense(t, at, channels, C, C_slopes, &sensitivity, count, direct, outputs, fit->states + first * n, slopes);
      for (int64_t j = 0; out->direct_slopes && j < p; j++)
        for (int64_t k = 0; k < count * channels; k++) slopes[k * p + j] += out->direct_slopes[j * all + place + k];
    }
    for (int64_t k = 0; k < count * channels; k++) fit->residual[place + k] = r->values[place + k] - outputs[k];
    if (sensitive) absorb(&to, count, rows, slopes, fit->residual + place);
  }
  if (to.all) end_triangles(&to, r->rms);
  free(room);
  free(response.all);
  free(sensitivity.all);
  return done;
}

/* Fill the fit of a record at coordinates, or the first state and the RMS of its residuals alone (`sizes`: channels).
 * Steps that are not given are made. Returns UNREACHED where the series does not reach one, NOT_FINITE where
 * derivatives by the first state are not finite. */
static int64_t fit_to(const Tables *t, const Linear *given, const double *eta, const Outputs *out, const Fitted *r,
                      const Fit *fit, double *sizes) {
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
  const Linear *at = given ? given : &own;
  if (!done && sizes) {
    double *room = malloc(BLOCK * out->channels * (n + 1) * sizeof(double));
    done = room ? begin(t, at, out, C, r, fit, room, sizes) : NO_MEMORY;
    free(room);
  } else if (!done)
    done = fit_at(t, at, out, C, C_slopes, r, fit);
  free(all);
  return done;
}

/* Fill the fit of a record at coordinates; returns as of `fit_to`. */
ENTRY int64_t dynid_fit(const Tables *t, const Linear *given, const double *eta, const Outputs *out, const Fitted *r,
                        const Fit *fit) {
  return fit_to(t, given, eta, out, r, fit, NULL);
}

/* Fill the RMS of the residuals (count x channels) at coordinates (count x p), NaN where a step is not reached or a
 * derivative not finite; `start`: room for a first state (n). */
ENTRY int64_t dynid_sizes(const Tables *t, int64_t count, const double *eta, const Outputs *out, const Fitted *r,
                          double *start, double *sizes) {
  const Fit fit = {.start = start};
  for (int64_t k = 0; k < count; k++) {
    double *size = sizes + k * out->channels;
    const int64_t done = fit_to(t, NULL, eta + k * t->p, out, r, &fit, size);
    if (done == NO_MEMORY) return NO_MEMORY;
    for (int64_t c = 0; done && c < out->channels; c++) size[c] = NAN;
  }
  return 0;
}

/* Set the shortest least-squares solution (columns) of rows [A, b] (rows x columns + 1). */
ENTRY int64_t dynid_least_squares(int64_t rows, int64_t columns, const double *both, double rank, double *x) {
  return least_squares(rows, columns, both, rank, x) ? 0 : NO_MEMORY;
}
