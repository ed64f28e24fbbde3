/* From a reduction program to a tape; see `dynid.bondgraph.program.frequency_sweep`. */
#include <math.h>
#include <stdlib.h>

#include "reals.h"

/* Operations of a program after its leaves, and of a tape. */
enum { P_LAPLACE = 2, P_ADD, P_SUB, P_MUL, P_DIV, P_NEG };
enum { LOAD, SHIFT, ADD, SUB, MUL, INV, NEG };
#define GENERAL 99 /* power of a register that is no monomial */
#define SHALLOW 4  /* operations above a leaf */
#define FEW 100    /* slots that stay in fast memory */

typedef struct {
  int64_t *codes, *one, *other, *powers;
  double *numbers;
  int64_t length;
} Listing;

INLINE int64_t put(Listing *d, int64_t code, int64_t one, int64_t other) {
  d->codes[d->length] = code;
  d->one[d->length] = one;
  d->other[d->length] = other;
  d->powers[d->length] = 0;
  memset(d->numbers + 3 * d->length, 0, 3 * sizeof(double));
  return d->length++;
}

INLINE int64_t put_monomial(Listing *d, int64_t code, int64_t one, const double *number, double sign,
                            int64_t power) {
  const int64_t at = put(d, code, one, one);
  d->numbers[3 * at] = sign * number[0];
  d->numbers[3 * at + 1] = sign * number[1];
  d->numbers[3 * at + 2] = number[2];
  d->powers[at] = power;
  return at;
}

/* Work out all needed registers that are a number times a power of s. */
static void monomials(int64_t count, const int64_t *codes, const int64_t *first, const int64_t *second,
                      double *numbers, const uint8_t *needed, int64_t *power) {
  for (int64_t r = 0; r < count; r++) {
    const int64_t op = codes[r];
    power[r] = GENERAL;
    if (!needed[r]) continue;
    if (op <= P_LAPLACE) {
      power[r] = op == P_LAPLACE;
      continue;
    }
    const int64_t one = first[r], other = op == P_NEG ? first[r] : second[r], p = power[one], q = power[other];
    if (p == GENERAL || q == GENERAL || ((op == P_ADD || op == P_SUB) && p != q)) continue;
    const int64_t total = op == P_MUL ? p + q : op == P_DIV ? p - q : p;
    if (total > POWERS || total < -POWERS) continue;
    const double *a = numbers + 3 * one, *b = numbers + 3 * other;
    const Real x = {a[0], a[1], a[2]}, y = {b[0], b[1], b[2]}, opposite = {-b[0], -b[1], b[2]};
    Real z;
    switch (op) {
    case P_MUL: z = real_product(x, y); break;
    case P_DIV: z = real_product(x, real_reciprocal(y)); break;
    case P_NEG: z = (Real){-x.high, -x.low, x.bound}; break;
    default: z = real_sum(x, op == P_ADD ? y : opposite);
    }
    power[r] = total;
    numbers[3 * r] = z.high;
    numbers[3 * r + 1] = z.low;
    numbers[3 * r + 2] = z.bound;
  }
}

/* Return the instruction that gives a register; a monomial is loaded where it is first read. */
static int64_t operand(Listing *d, int64_t *place, const double *numbers, const int64_t *power, int64_t r) {
  if (place[r] < 0) {
    place[r] = d->length; /* a load names itself */
    put_monomial(d, LOAD, d->length, numbers + 3 * r, 1.0, power[r]);
  }
  return place[r];
}

/* Fill a listing (room for three instructions a register and one a wanted one) with what computes the wanted
 * registers; `places` are theirs. Returns its length. */
static int64_t lower(int64_t count, const int64_t *codes, const int64_t *first, const int64_t *second,
                     double *numbers, int64_t wanted_count, const int64_t *wanted, Listing *d, int64_t *places,
                     uint8_t *needed, int64_t *power, int64_t *place, int64_t *inverse) {
  for (int64_t k = 0; k < wanted_count; k++) needed[wanted[k]] = 1;
  for (int64_t r = count - 1; r >= 0; r--)
    if (needed[r] && codes[r] >= P_ADD) {
      needed[first[r]] = 1;
      if (codes[r] != P_NEG) needed[second[r]] = 1;
    }
  monomials(count, codes, first, second, numbers, needed, power);
  for (int64_t r = 0; r < count; r++) place[r] = inverse[r] = -1;
  d->length = 0;
  for (int64_t r = 0; r < count; r++) {
    if (!needed[r] || power[r] != GENERAL) continue;
    const int64_t op = codes[r], a = first[r], b = second[r];
    if (op == P_DIV) { /* a product with a reciprocal, which is shared by all that divide by the same */
      const int64_t divisor = operand(d, place, numbers, power, b);
      if (inverse[b] < 0) inverse[b] = put(d, INV, divisor, divisor);
      const int one = power[a] == 0 && numbers[3 * a] == 1.0 && numbers[3 * a + 1] == 0.0;
      place[r] = one ? inverse[b] : put(d, MUL, operand(d, place, numbers, power, a), inverse[b]);
    } else if (op == P_ADD || op == P_SUB) { /* a monomial is added as such, without being loaded */
      if (power[b] != GENERAL) {
        const int64_t one = operand(d, place, numbers, power, a);
        place[r] = put_monomial(d, SHIFT, one, numbers + 3 * b, op == P_ADD ? 1.0 : -1.0, power[b]);
      } else if (power[a] == GENERAL) {
        place[r] = put(d, op == P_ADD ? ADD : SUB, place[a], place[b]);
      } else {
        int64_t other = place[b];
        if (op == P_SUB) other = put(d, NEG, other, other); /* number - x = -x + number */
        place[r] = put_monomial(d, SHIFT, other, numbers + 3 * a, 1.0, power[a]);
      }
    } else {
      const int64_t one = operand(d, place, numbers, power, a);
      place[r] = op == P_NEG ? put(d, NEG, one, one) : put(d, MUL, one, operand(d, place, numbers, power, b));
    }
  }
  for (int64_t k = 0; k < wanted_count; k++) places[k] = operand(d, place, numbers, power, wanted[k]);
  return d->length;
}

/* Fill an order in which few instructions are alive at a time; return how many are in it: the one in which they are
 * written, but what is near the leaves (the immittance of an element, say) comes only when it is asked for, or not
 * at all. Where it goes deep, every instruction does, of its operands first the one that needs more slots
 * (R. Sethi, J. D. Ullman, J. ACM 17 (1970) 715-728). */
static int64_t ordered(const Listing *d, int64_t wanted_count, const int64_t *places, int deep, int64_t *order,
                       int64_t *weight, uint8_t *root, uint8_t *placed, int64_t *stack) {
  int64_t done = 0;
  for (int64_t at = 0; at < d->length; at++) {
    weight[at] = deep; /* slots that it needs, or operations above the leaves */
    if (d->codes[at] != LOAD) {
      const int64_t a = weight[d->one[at]], b = weight[d->other[at]];
      const int more = deep ? a == b && d->one[at] != d->other[at] : 1;
      weight[at] = (a > b ? a : b) + more;
    }
    root[at] = !deep && weight[at] > SHALLOW;
    placed[at] = 0;
  }
  for (int64_t k = 0; k < wanted_count; k++) root[places[k]] = 1;
  for (int64_t start = 0; start < d->length; start++) {
    if (!root[start]) continue;
    int64_t top = 0;
    stack[0] = start;
    while (top >= 0) {
      const int64_t at = stack[top], here = top;
      if (!placed[at] && d->codes[at] != LOAD) {
        const int turned = deep && weight[d->one[at]] > weight[d->other[at]];
        const int64_t last = turned ? d->other[at] : d->one[at], next = turned ? d->one[at] : d->other[at];
        if (!placed[last]) stack[++top] = last;
        if (!placed[next]) stack[++top] = next;
      }
      if (top > here) continue; /* back to it when its operands are placed */
      top--;
      if (!placed[at]) {
        placed[at] = 1;
        order[done++] = at;
      }
    }
  }
  return done;
}

/* Give each instruction a slot, which is free again when the last that reads it has run; return how many. */
static int64_t slotted(const Listing *d, int64_t done, const int64_t *order, int64_t wanted_count,
                       const int64_t *places, int64_t *uses, int64_t *slot, int64_t *spare) {
  int64_t available = 0, slots = 0;
  for (int64_t at = 0; at < d->length; at++) {
    uses[at] = 0;
    slot[at] = -1;
  }
  for (int64_t k = 0; k < wanted_count; k++) uses[places[k]]++; /* never given back */
  for (int64_t k = 0; k < done; k++) { /* a load names itself: others read it later */
    uses[d->one[order[k]]]++;
    uses[d->other[order[k]]]++;
  }
  for (int64_t k = 0; k < done; k++) {
    const int64_t at = order[k], read[2] = {d->one[at], d->other[at]};
    slot[at] = available ? spare[--available] : slots++;
    for (int j = 0; j < 2; j++)
      if (--uses[read[j]] == 0) spare[available++] = slot[read[j]];
  }
  return slots;
}

/* Compile a program (codes, operands and numbers of its registers) to a tape that gives the wanted registers.
 *
 * `rows` ((3 count + wanted) x 5) and `numbers_of` (... x 3) are filled, `places` are the slots of those
 * wanted; sizes are the length of the tape and its slots. */
ENTRY int64_t dynid_tape(int64_t count, const int64_t *codes, const int64_t *first, const int64_t *second,
                         double *numbers, int64_t wanted_count, const int64_t *wanted, int64_t *rows,
                         double *numbers_of, int64_t *places, int64_t *sizes) {
  const int64_t most = 3 * count + wanted_count;
  int64_t *all = malloc(sizeof(int64_t) * (3 * count + 11 * most + 2));
  double *listed = malloc(sizeof(double) * 3 * most + 1);
  uint8_t *flags = calloc(count + 2 * most + 1, 1);
  if (all && listed && flags) {
    int64_t *power = all, *place = power + count, *inverse = place + count, *rest = inverse + count;
    Listing d = {rest, rest + most, rest + 2 * most, rest + 3 * most, listed, 0};
    int64_t *order = rest + 4 * most, *weight = rest + 5 * most, *slot = rest + 6 * most;
    int64_t *uses = rest + 7 * most, *spare = rest + 8 * most, *stack = rest + 9 * most;
    lower(count, codes, first, second, numbers, wanted_count, wanted, &d, places, flags, power, place, inverse);
    int64_t least = INT64_MAX;
    for (int way = 0; way < 3; way++) { /* as written; deep; as written again, if that took fewer slots */
      sizes[0] = ordered(&d, wanted_count, places, way == 1, order, weight, flags + count, flags + count + most, stack);
      sizes[1] = slotted(&d, sizes[0], order, wanted_count, places, uses, slot, spare);
      if (sizes[1] <= FEW || (way == 1 && sizes[1] < least)) break;
      least = sizes[1];
    }
    for (int64_t k = 0; k < sizes[0]; k++) {
      const int64_t at = order[k];
      const int64_t row[5] = {d.codes[at], slot[d.one[at]], slot[d.other[at]], slot[at], d.powers[at]};
      memcpy(rows + 5 * k, row, sizeof row);
      memcpy(numbers_of + 3 * k, listed + 3 * at, 3 * sizeof(double));
    }
    for (int64_t k = 0; k < wanted_count; k++) places[k] = slot[places[k]];
    free(all), free(listed), free(flags);
    return 0;
  }
  free(all), free(listed), free(flags);
  return NO_MEMORY;
}
