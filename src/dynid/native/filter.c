/* The pass of the filter; see `dynid.identification.estimators.filter`. */
#include "steps.h"

/* Squares between these neither overflow nor lose digits. */
#define SMALL 1e-280
#define LARGE 1e280

typedef struct {
  const double *measured, *weights; /* samples x channels */
  const double *origin, *most, *runaway; /* p */
  double part;
} Record;

typedef struct {
  double *eta, *deviations, *states, *bands, *innovations;
} History;

typedef struct {
  double *driven, *moved, *growth, *total, *root, *row, *phi, *gain, *correction, *lengths, *all;
} Room;

INLINE int room_for(const Tables *t, const Linear *at, int64_t size, int64_t width, Room *room) {
  const int64_t n = t->n, fed = n + t->q, pitch = at->tall / n;
  double *arena = room->all =
      calloc(padded(fed) + padded(at->wide) + padded(1 + t->p) + padded(n * pitch) + padded(n * width) +
                 5 * padded(size) + padded(width), sizeof(double));
  if (!arena) return 0;
  room->driven = taken(&arena, fed);
  room->moved = taken(&arena, at->wide);
  room->growth = taken(&arena, 1 + t->p);
  room->total = taken(&arena, n * pitch);
  room->root = taken(&arena, n * width);
  room->row = taken(&arena, size);
  room->gain = taken(&arena, size);
  room->correction = taken(&arena, size);
  room->lengths = taken(&arena, size);
  room->phi = taken(&arena, width);
  return 1;
}

/* Return 1 if coordinates are too far from those of the steps. */
INLINE int stale(const Tables *t, const Linear *at, const double *z, const double *spread, const Record *r) {
  for (int64_t j = 0; j < t->p; j++) {
    const double most = r->part * spread[j] < r->most[j] ? r->part * spread[j] : r->most[j];
    if (!(fabs(z[t->n + j] - at->eta[j]) <= most)) return 1;
  }
  return 0;
}

/* Take state and root to a node from the one before it. */
INLINE void propagate(const Tables *t, const Linear *at, int64_t node, double *z, double *S, int64_t width,
                      Room *room) {
  const int64_t n = t->n, p = t->p, q = t->q, fed = n + q, wide = at->wide, tall = at->tall;
  const int64_t pitch = tall / n, length = t->which[node - 1];
  double *total = room->total;
  room->growth[0] = 1.0;
  for (int64_t j = 0; j < p; j++) {
    const double left = z[n + j] - at->eta[j];
    room->growth[1 + j] = left + t->log[j] * left * left / 2;
  }
  row_product(1 + p, tall, room->growth, at->phis + length * (1 + p) * tall, tall, total);
  memcpy(room->driven, z, n * sizeof(double));
  memcpy(room->driven + n, t->W + (node - 1) * q, q * sizeof(double));
  row_product(fed, wide, room->driven, at->forward + length * fed * wide, wide, room->moved);
  for (int64_t i = 0; i < n; i++) {
    const double *moved = room->moved + i * (1 + p);
    double to = moved[0];
    for (int64_t j = 0; j < p; j++) {
      const double change = moved[1 + j] * room->growth[1 + j];
      total[i * pitch + n + j] = moved[1 + j] + t->log[j] * change;
      to += change;
    }
    z[i] = to;
  }
  product(n, n + p, width, total, pitch, S, width, room->root, width);
  memcpy(S, room->root, n * width * sizeof(double));
}

/* Set the derivatives of a channel by state and coordinates; return how its direct term changes. */
INLINE double readout(const Tables *t, const Linear *at, const Outputs *out, int64_t sample, int64_t channel,
                      const double *z, Room *room) {
  const int64_t n = t->n, p = t->p;
  double *row = room->row, direct = 0.0;
  memcpy(row, out->C + channel * n, n * sizeof(double));
  if (!out->C_slopes && !out->direct_slopes) return direct;
  for (int64_t j = 0; j < p; j++) {
    const double left = z[n + j] - at->eta[j];
    double growth = left, here = 1.0;
    row[n + j] = 0.0;
    if (out->affine) {
      growth = here = exp(z[n + j]);
    } else {
      growth += t->log[j] * left * left / 2;
      here += t->log[j] * growth;
    }
    if (out->C_slopes) {
      const double *slopes = out->C_slopes + (j * out->channels + channel) * n;
      for (int64_t i = 0; i < n; i++) {
        row[i] += growth * slopes[i];
        row[n + j] += here * slopes[i] * z[i];
      }
    }
    if (out->direct_slopes) {
      const double slope = out->direct_slopes[(j * out->samples + sample) * out->channels + channel];
      direct += growth * slope;
      row[n + j] += here * slope;
    }
  }
  return direct;
}

/* Take one sample into account, channel by channel, in units of its noise (Potter). */
INLINE void update(const Tables *t, const Linear *at, const Outputs *out, int64_t sample, const Record *record,
                   double *z, double *S, int64_t width, double *normalised, Room *room) {
  const int64_t n = t->n, size = n + t->p;
  double *row = room->row, *phi = room->phi, *gain = room->gain, *correction = room->correction;
  memset(correction, 0, size * sizeof(double));
  for (int64_t channel = 0; channel < out->channels; channel++) {
    const int64_t place = sample * out->channels + channel;
    if (isnan(record->measured[place])) continue;
    const double weight = record->weights[place];
    double innovation = record->measured[place] - out->direct[place];
    innovation -= readout(t, at, out, sample, channel, z, room); /* about the state before the sample */
    for (int64_t i = 0; i < n; i++) innovation -= row[i] * z[i];
    for (int64_t i = 0; i < size; i++) row[i] *= weight;
    innovation *= weight;
    row_product(size, width, row, S, width, phi);
    const double spread = 1.0 + dot(width, phi, phi);
    for (int64_t i = 0; i < size; i++) innovation -= row[i] * correction[i];
    normalised[place] = innovation / sqrt(spread);
    const double shrink = -1 / (1 + sqrt(1 / spread));
    for (int64_t i = 0; i < size; i++) {
      gain[i] = dot(width, S + i * width, phi) / spread;
      correction[i] += gain[i] * innovation;
      gain[i] *= shrink;
    }
    for (int64_t i = 0; i < size; i++)
      for (int64_t c = 0; c < width; c += WIDE)
        store(S + i * width + c, load(S + i * width + c) + gain[i] * load(phi + c));
  }
  for (int64_t i = 0; i < size; i++) z[i] += correction[i];
}

/* Return the length of a row whose squares may overflow or vanish. */
INLINE double length_of(const double *row, int64_t width) {
  double unit = 0.0, square = 0.0;
  for (int64_t c = 0; c < width; c++) unit = fabs(row[c]) > unit ? fabs(row[c]) : unit;
  if (unit == 0.0) return 0.0;
  for (int64_t c = 0; c < width; c++) square += (row[c] / unit) * (row[c] / unit);
  return sqrt(square) * unit;
}

/* Set the lengths (size) of the rows of a root, however large or small. */
INLINE void set_lengths(const double *S, int64_t size, int64_t width, double *lengths) {
  int ordinary = 1;
  for (int64_t i = 0; i < size; i++) {
    lengths[i] = dot(width, S + i * width, S + i * width);
    ordinary &= lengths[i] > SMALL && lengths[i] < LARGE;
  }
  for (int64_t i = 0; i < size; i++) lengths[i] = ordinary ? sqrt(lengths[i]) : length_of(S + i * width, width);
}

ENTRY int64_t dynid_lengths(const double *S, int64_t size, int64_t width, double *lengths) {
  set_lengths(S, size, width, lengths);
  return 0;
}

/* Filter from a node on, with z (n + p), S (n + p x width) and spread (p) in place.
 *
 * Returns the node that is not reached: the number of nodes; one whose step the series does not reach; or
 * minus one minus the node where a coordinate ran away. */
ENTRY int64_t dynid_filter(const Tables *t, const Linear *at, const Outputs *out, const Record *record,
                           int64_t first, double *z, double *S, int64_t width, double *spread,
                           const History *history) {
  const int64_t n = t->n, p = t->p, size = n + p;
  Room room = {0};
  Work series = {0};
  int64_t node = first;
  if (!work(t, &series) || !room_for(t, at, size, width, &room)) {
    free(series.all);
    return NO_MEMORY;
  }
  for (; node < t->nodes; node++) {
    if (node > 0) {
      if (stale(t, at, z, spread, record)) {
        memcpy(at->eta, z + n, p * sizeof(double));
        memset(at->ready, 0, t->lengths);
      }
      const int64_t length = t->which[node - 1];
      if (!at->ready[length] && !linearise(t, length, at, &series)) break;
      propagate(t, at, node, z, S, width, &room);
    }
    const int64_t sample = t->sample[node];
    if (sample < 0) continue;
    update(t, at, out, sample, record, z, S, width, history->innovations, &room);
    set_lengths(S, size, width, room.lengths);
    int away = 0;
    for (int64_t j = 0; j < p; j++) {
      away |= !(fabs(z[n + j] - record->origin[j]) < record->runaway[j]);
      spread[j] = room.lengths[n + j];
      history->eta[sample * p + j] = z[n + j];
      history->deviations[sample * p + j] = spread[j];
    }
    if (away) {
      node = -1 - node;
      break;
    }
    memcpy(history->states + sample * n, z, n * sizeof(double));
    memcpy(history->bands + sample * n, room.lengths, n * sizeof(double));
  }
  free(room.all);
  free(series.all);
  return node;
}
