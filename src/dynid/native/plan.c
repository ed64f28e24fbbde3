/* A graph's reduction program from its nodes and bonds as integers: the junction structure, the elimination of all
 * junctions but the root, and the arithmetic that it writes down. The same, step by step, as
 * `dynid.bondgraph.reduction` and `dynid.bondgraph.program.program` do; what is rare there is refused here. */
#include <stdlib.h>

#include "products.h"

enum { SE, SF, I_, C_, R_, TF, GY, ZERO, ONE, A_ };                       /* types of nodes */
enum { P_CONSTANT, P_PARAMETER, P_LAPLACE, P_ADD, P_SUB, P_MUL, P_DIV, P_NEG }; /* operations */
enum { REFUSED = 1 };
#define COMPARED 20000 /* registers among which equal values are looked for */
#define NONE (-1)
#define BOND (-1) /* a tie: a bond, more than one thing, or a two-port (twice its number, 1 more: inverse) */
#define SEVERAL (-2)

typedef int64_t Int;
typedef unsigned __int128 Wide;

/* A residue as a quotient: inverses are taken only where values are compared. Both are multiplied by 2^64 modulo
 * the prime, so that products need no division (Montgomery 1985). */
typedef struct {
  uint64_t above, below;
} Residue;

typedef struct {
  Int code, a, b;
} Operation;

typedef struct {
  Int other, next, before, entry, tie; /* the other row of this half of an edge; the entry's register */
} Half;

typedef struct {
  Int name, register_, origin, next; /* of an immittance: a node, or NONE - 1 - junction */
} Term;

typedef struct {
  Int source, amount, next;
} Drive;

typedef struct {
  Int tail, head, two_port, inverse;
} Coupling;

typedef struct {
  Int round, degree, rank;
} Turn;

typedef struct {
  /* nodes and bonds */
  Int nodes, bonds;
  const int8_t *types;
  const Int *ends;
  /* junction structure */
  Int junctions, couplings;
  Int *place;                 /* of nodes */
  Int *kind, *fixing, *drawn; /* of junctions: 0 or 1; a source or NONE; the node, or NONE - 1 - bond of a bare one */
  Int *element_start, *elements, *feed_start, *feeds, *signs, *tied_start, *tied;
  Coupling *coupling;
  /* program */
  uint64_t prime, negative_inverse, unity, square; /* of 2^64: modulo the prime, and its square */
  int general;
  Residue *values; /* of parameters, by node */
  Residue laplace;
  Int length, room, image_room, zero, one, s;
  Operation *ops;
  Residue *images;
  int32_t *known, *compared; /* hash tables of entries, and of registers by value */
  Int known_size, compared_size, entries, entry_room;
  struct Known *entry_list;
  /* network */
  Int root, rows, *row_of, *at, *depth; /* of junctions, and back; row 0 is the root */
  Int *first_half, *last_half, *degree, *first_term, *last_term, *first_drive, *rank, *round, *gone;
  Half *halves;
  Int half_count, half_room, term_count, term_room, drive_count, drive_room;
  Term *terms;
  Drive *drives;
  Turn *heap;
  Int heap_count, heap_room, *by_rank;
  Int *pivots, pivot_count, pivot_room;
  Int input_count;
  const Int *inputs;
  uint8_t *driving;
  int failed, memory; /* refused; out of memory */
} Plan;

/* Return 1, and end the plan, where there is no memory for what was asked for. */
INLINE int lacks(Plan *p, int missing) {
  if (missing) p->memory = p->failed = 1;
  return missing;
}

static void *larger(Plan *p, void *old, Int *room, Int needed, size_t size) {
  if (needed <= *room) return old;
  const Int more = 2 * *room > needed ? 2 * *room : needed + 64;
  void *made = realloc(old, more * size);
  if (lacks(p, !made)) return old;
  *room = more;
  return made;
}

/* --- residues --- */

INLINE uint64_t residue_product(const Plan *p, uint64_t a, uint64_t b) {
  const Wide product = (Wide)a * b;
  const uint64_t whole = (uint64_t)((product + (Wide)((uint64_t)product * p->negative_inverse) * p->prime) >> 64);
  return whole >= p->prime ? whole - p->prime : whole;
}
INLINE uint64_t plus(const Plan *p, uint64_t a, uint64_t b) {
  const uint64_t sum = a + b; /* the prime is below 2^62 */
  return sum >= p->prime ? sum - p->prime : sum;
}
INLINE uint64_t opposite(const Plan *p, uint64_t a) { return a ? p->prime - a : 0; }

INLINE uint64_t residue(const Plan *p, Int value) { return residue_product(p, (uint64_t)value, p->square); }

static void set_prime(Plan *p, uint64_t prime) {
  uint64_t by = prime; /* its inverse modulo 2^64: every step doubles the bits that hold */
  for (int k = 0; k < 6; k++) by *= 2 - prime * by;
  p->prime = prime;
  p->negative_inverse = 0 - by;
  p->unity = (uint64_t)(((Wide)1 << 64) % prime);
  p->square = (uint64_t)((Wide)p->unity * p->unity % prime);
}

static uint64_t inverse(const Plan *p, uint64_t a) {
  int64_t r = (int64_t)p->prime, next = (int64_t)a, t = 0, following = 1;
  while (next) {
    const int64_t q = r / next, rest = r - q * next, left = t - q * following;
    r = next, next = rest;
    t = following, following = left;
  }
  const uint64_t plain = (uint64_t)(t < 0 ? t + (int64_t)p->prime : t);
  return residue_product(p, residue_product(p, plain, p->square), p->square);
}

static Residue computed(const Plan *p, Int code, Residue x, Residue y) {
  switch (code) {
  case P_NEG: return (Residue){opposite(p, x.above), x.below};
  case P_MUL:
    return (Residue){residue_product(p, x.above, y.above),
                     x.below == p->unity && y.below == p->unity ? p->unity : residue_product(p, x.below, y.below)};
  case P_DIV:
    return (Residue){y.below == p->unity ? x.above : residue_product(p, x.above, y.below),
                     x.below == p->unity ? y.above : residue_product(p, x.below, y.above)};
  default: break;
  }
  const uint64_t above = code == P_SUB ? opposite(p, y.above) : y.above;
  if (x.below == y.below) return (Residue){plus(p, x.above, above), x.below};
  return (Residue){plus(p, residue_product(p, x.above, y.below), residue_product(p, above, x.below)), residue_product(p, x.below, y.below)};
}

/* --- program --- */

INLINE uint64_t mixed(uint64_t x) {
  x ^= x >> 31;
  x *= 0x7fb5d329728ea185u;
  x ^= x >> 27;
  x *= 0x81dadef4bc2dd44du;
  return x ^ x >> 33;
}

static int same(Operation x, Operation y) { return x.code == y.code && x.a == y.a && x.b == y.b; }

/* Sums and products of the same operands in either order are one. */
INLINE Operation ordered(Operation x) {
  return (x.code == P_ADD || x.code == P_MUL) && x.b < x.a ? (Operation){x.code, x.b, x.a} : x;
}

/* What is known: keys and registers, as two operations may share a register. */
typedef struct Known {
  Operation key;
  Int register_;
} Known;

static int32_t *find_known(Plan *p, Operation key) {
  const uint64_t mask = (uint64_t)p->known_size - 1;
  uint64_t at = mixed(((uint64_t)key.a * 8 + (uint64_t)key.code) ^ (uint64_t)key.b << 32);
  while (p->known[at & mask] != NONE && !same(p->entry_list[p->known[at & mask]].key, key)) at++;
  return p->known + (at & mask);
}

static void set_known(Plan *p, Operation key, Int register_) {
  p->entry_list = larger(p, p->entry_list, &p->entry_room, p->entries + 1, sizeof(Known));
  if (p->failed) return;
  *find_known(p, key) = (int32_t)p->entries;
  p->entry_list[p->entries++] = (Known){key, register_};
  if (2 * p->entries <= p->known_size) return;
  int32_t *made = realloc(p->known, sizeof(int32_t) * 4 * p->known_size);
  if (lacks(p, !made)) return;
  p->known = made;
  p->known_size *= 4;
  memset(made, -1, sizeof(int32_t) * p->known_size);
  for (Int k = 0; k < p->entries; k++) *find_known(p, p->entry_list[k].key) = (int32_t)k;
}

static int32_t *find_value(Plan *p, uint64_t value) {
  const uint64_t mask = (uint64_t)p->compared_size - 1;
  uint64_t at = mixed(value);
  while (p->compared[at & mask] != NONE && p->images[p->compared[at & mask]].above != value) at++;
  return p->compared + (at & mask);
}

static Int negated(Plan *p, Int a);

static Int emit(Plan *p, Operation op, Residue image) {
  if (p->failed) return p->zero;
  p->ops = larger(p, p->ops, &p->room, p->length + 1, sizeof(Operation));
  p->images = larger(p, p->images, &p->image_room, p->length + 1, sizeof(Residue));
  if (p->failed) return p->zero;
  const Operation key = ordered(op);
  const int32_t known = *find_known(p, key);
  if (known != NONE) return p->entry_list[known].register_;
  const Int following = p->length;
  if (p->general && following < COMPARED) { /* look for this value, or its opposite */
    if (image.below != p->unity)
      image = (Residue){residue_product(p, image.above, inverse(p, image.below)), p->unity};
    int32_t *equal = find_value(p, image.above);
    if (*equal != NONE) {
      if (op.code >= P_ADD) {
        set_known(p, key, *equal);
        return *equal;
      }
    } else {
      const Int contrary = image.above ? *find_value(p, p->prime - image.above) : NONE;
      if (contrary != NONE && op.code >= P_ADD && op.code != P_NEG) {
        const Int negative = negated(p, contrary);
        set_known(p, key, negative);
        return negative;
      }
      *equal = (int32_t)following;
    }
  }
  set_known(p, key, following);
  if (p->failed) return p->zero;
  p->ops[following] = op;
  p->images[following] = image;
  p->length++;
  return following;
}

static Int emitted(Plan *p, Int code, Int a, Int b) {
  const Residue image = computed(p, code, p->images[a], p->images[b]);
  return emit(p, (Operation){code, a, b}, image);
}

INLINE int is_zero(const Plan *p, Int a) { return p->images[a].above == 0; }

static Int parameter(Plan *p, Int node) { return emit(p, (Operation){P_PARAMETER, node, 0}, p->values[node]); }

static Int negated(Plan *p, Int a) {
  if (a == p->zero) return a;
  return p->ops[a].code == P_NEG ? p->ops[a].a : emitted(p, P_NEG, a, 0);
}

static Int subtracted(Plan *p, Int a, Int b);

static Int added(Plan *p, Int a, Int b) {
  if (a == p->zero) return b;
  if (b == p->zero) return a;
  if (p->ops[b].code == P_NEG) return subtracted(p, a, p->ops[b].a);
  if (p->ops[a].code == P_NEG) return subtracted(p, b, p->ops[a].a);
  return emitted(p, P_ADD, a, b);
}

static Int subtracted(Plan *p, Int a, Int b) {
  if (b == p->zero) return a;
  if (a == p->zero) return negated(p, b);
  if (p->ops[b].code == P_NEG) return added(p, a, p->ops[b].a);
  return a == b ? p->zero : emitted(p, P_SUB, a, b);
}

static Int divided(Plan *p, Int a, Int b);

static Int times(Plan *p, Int a, Int b) {
  if (a == p->zero || b == p->zero) return p->zero;
  if (a == p->one) return b;
  if (b == p->one) return a;
  const Operation first = p->ops[a], second = p->ops[b];
  if (first.code == P_NEG) return negated(p, times(p, first.a, b));
  if (second.code == P_NEG) return negated(p, times(p, a, second.a));
  if (first.code == P_DIV && first.a == p->one) return divided(p, b, first.b);
  if (second.code == P_DIV && second.a == p->one) return divided(p, a, second.b);
  return emitted(p, P_MUL, a, b);
}

static Int divided(Plan *p, Int a, Int b) {
  if (is_zero(p, b)) {
    p->failed = 1;
    return p->zero;
  }
  if (a == p->zero || b == p->one) return a;
  if (a == b) return p->one;
  const Operation first = p->ops[a], by = p->ops[b];
  if (first.code == P_NEG) return negated(p, divided(p, first.a, b));
  if (by.code == P_NEG) return negated(p, divided(p, a, by.a));
  if (by.code == P_DIV) {
    if (by.a == p->one) return times(p, a, by.b);
    const Int above = times(p, a, by.b);
    return divided(p, above, by.a);
  }
  return emitted(p, P_DIV, a, b);
}

INLINE Int inverted(Plan *p, Int a) { return divided(p, p->one, a); }

static int are_opposite(const Plan *p, Int a, Int b) {
  return computed(p, P_ADD, p->images[a], p->images[b]).above == 0;
}

/* --- junction structure --- */

static Int found(Int *root, Int node) {
  while (root[node] != node) {
    root[node] = root[root[node]];
    node = root[node];
  }
  return node;
}

INLINE int is_junction(Int type) { return type == ZERO || type == ONE; }
INLINE int is_two_port(Int type) { return type == TF || type == GY || type == A_; }

typedef struct {
  Int node, junction, sign;
} Attached;

static Int bare(Plan *p, Int bond, Int kind) {
  p->kind[p->junctions] = kind;
  p->fixing[p->junctions] = NONE;
  p->drawn[p->junctions] = NONE - 1 - bond;
  return p->junctions++;
}

static void attach(Plan *p, Attached *attached, Int *count, Int node, Int junction, int incoming) {
  p->place[node] = junction;
  const Int type = p->types[node];
  if (type == (p->kind[junction] ? SF : SE)) {
    if (p->fixing[junction] != NONE) p->failed = REFUSED;
    p->fixing[junction] = node;
    return;
  }
  attached[(*count)++] = (Attached){node, junction, incoming ? 1 : -1};
}

static Int side(Plan *p, Attached *attached, Int *count, Int *between, Int bond, int incoming) {
  const Int neighbour = p->ends[2 * bond + (incoming ? 0 : 1)], type = p->types[neighbour];
  if (is_junction(type)) return p->place[neighbour];
  if (between[bond] == NONE) {
    between[bond] = bare(p, bond, type != SF);
    if (!is_two_port(type)) attach(p, attached, count, neighbour, between[bond], incoming);
  }
  return between[bond];
}

static void structure(Plan *p) {
  Int *root = malloc(sizeof(Int) * (3 * p->nodes + p->bonds + 1)), *in = root + p->nodes, *out = in + p->nodes;
  Int *between = out + p->nodes;
  const Int most = p->nodes + 2 * p->bonds + 1;
  Attached *attached = malloc(sizeof(Attached) * (p->nodes + 1));
  p->place = malloc(sizeof(Int) * (p->nodes + 1));
  p->kind = malloc(sizeof(Int) * 3 * most);
  p->coupling = malloc(sizeof(Coupling) * (2 * p->nodes + p->bonds + 1));
  if (lacks(p, !root || !attached || !p->place || !p->kind || !p->coupling)) {
    free(root), free(attached);
    return;
  }
  p->fixing = p->kind + most, p->drawn = p->fixing + most;
  Int count = 0;
  for (Int k = 0; k < p->nodes; k++) {
    root[k] = k, p->place[k] = NONE;
    if (p->types[k] == A_) p->failed = REFUSED;
  }
  for (Int k = 0; k < p->bonds; k++) {
    const Int tail = p->ends[2 * k], head = p->ends[2 * k + 1];
    between[k] = NONE;
    out[tail] = in[head] = k; /* read of two-ports alone, which have one of each */
    if (!is_junction(p->types[tail]) || p->types[tail] != p->types[head]) continue;
    const Int a = found(root, tail), b = found(root, head);
    if (a == b) p->failed = REFUSED; /* a ring */
    root[a < b ? b : a] = a < b ? a : b;
  }
  for (Int k = 0; k < p->nodes && !p->failed; k++) { /* the first of those that are one has the lowest number */
    if (!is_junction(p->types[k])) continue;
    const Int first = found(root, k);
    if (first == k) {
      p->kind[p->junctions] = p->types[k] == ONE;
      p->fixing[p->junctions] = NONE;
      p->drawn[p->junctions] = k;
      p->place[k] = p->junctions++;
    } else {
      p->place[k] = p->place[first];
    }
  }
  for (Int k = 0; k < p->bonds && !p->failed; k++) {
    const Int tail = p->ends[2 * k], head = p->ends[2 * k + 1];
    if (is_two_port(p->types[tail]) || is_two_port(p->types[head])) continue;
    const int a = is_junction(p->types[tail]), b = is_junction(p->types[head]);
    if (a && b) {
      if (p->place[tail] != p->place[head])
        p->coupling[p->couplings++] = (Coupling){p->place[tail], p->place[head], NONE, 0};
    } else if (a) {
      attach(p, attached, &count, head, p->place[tail], 0);
    } else if (b) {
      attach(p, attached, &count, tail, p->place[head], 1);
    } else {
      p->failed = REFUSED; /* two one-ports face to face */
    }
  }
  for (Int k = 0; k < p->nodes && !p->failed; k++) {
    if (!is_two_port(p->types[k])) continue;
    Int primary = side(p, attached, &count, between, in[k], 1);
    const Int secondary = side(p, attached, &count, between, out[k], 0);
    if ((p->kind[primary] == p->kind[secondary]) == (p->types[k] == TF)) {
      const Int extra = bare(p, in[k], !p->kind[primary]);
      p->coupling[p->couplings++] = (Coupling){primary, extra, NONE, 0};
      primary = extra;
    }
    if (primary != secondary)
      p->coupling[p->couplings++] = (Coupling){primary, secondary, k, !p->kind[primary]};
  }
  const Int j = p->junctions;
  Int *lists = calloc(3 * (j + 2) + 3 * count + 2 * p->couplings + 1, sizeof(Int));
  if (!lacks(p, !lists) && !p->failed) {
    p->element_start = lists, p->feed_start = lists + j + 2, p->tied_start = lists + 2 * (j + 2);
    p->elements = lists + 3 * (j + 2), p->feeds = p->elements + count, p->signs = p->feeds + count;
    p->tied = p->signs + count;
    for (Int k = 0; k < count; k++)
      (p->types[attached[k].node] <= SF ? p->feed_start : p->element_start)[attached[k].junction + 2]++;
    for (Int k = 0; k < p->couplings; k++)
      p->tied_start[p->coupling[k].tail + 2]++, p->tied_start[p->coupling[k].head + 2]++;
    for (Int k = 2; k < j + 2; k++) {
      p->element_start[k] += p->element_start[k - 1];
      p->feed_start[k] += p->feed_start[k - 1];
      p->tied_start[k] += p->tied_start[k - 1];
    }
    for (Int k = 0; k < count; k++) { /* starts move by one place here */
      const Attached it = attached[k];
      if (p->types[it.node] <= SF) {
        const Int at = p->feed_start[it.junction + 1]++;
        p->feeds[at] = it.node, p->signs[at] = it.sign;
      } else {
        p->elements[p->element_start[it.junction + 1]++] = it.node;
      }
    }
    for (Int k = 0; k < p->couplings; k++) {
      p->tied[p->tied_start[p->coupling[k].tail + 1]++] = k;
      p->tied[p->tied_start[p->coupling[k].head + 1]++] = k;
    }
  } else {
    free(lists);
  }
  free(root), free(attached);
}

/* --- network --- */

static void put_drive(Plan *p, Int row, Int source, Int amount) { /* feed: what cancels disappears */
  Int *link = p->first_drive + row;
  while (*link != NONE && p->drives[*link].source != source) link = &p->drives[*link].next;
  const Int total = added(p, *link == NONE ? p->zero : p->drives[*link].amount, amount);
  if (is_zero(p, total)) {
    if (*link != NONE) *link = p->drives[*link].next;
  } else if (*link != NONE) {
    p->drives[*link].amount = total;
  } else {
    const Int at = p->drive_count++;
    *link = at; /* before the array moves */
    p->drives = larger(p, p->drives, &p->drive_room, p->drive_count, sizeof(Drive));
    if (p->failed) return;
    p->drives[at] = (Drive){source, total, NONE};
  }
}

static void stand(Plan *p, Int row, Int name, Int register_, Int origin) {
  const Int at = p->term_count++;
  p->terms = larger(p, p->terms, &p->term_room, p->term_count, sizeof(Term));
  if (p->failed) return;
  p->terms[at] = (Term){name, register_, origin, NONE};
  if (p->first_term[row] == NONE) p->first_term[row] = at;
  else p->terms[p->last_term[row]].next = at;
  p->last_term[row] = at;
}

static Int diagonal(Plan *p, Int row) {
  Int total = p->zero;
  for (Int t = p->first_term[row]; t != NONE; t = p->terms[t].next) total = added(p, total, p->terms[t].register_);
  return total;
}

static Int half_of(const Plan *p, Int row, Int column) { /* from the side with fewer edges */
  if (p->degree[row] <= p->degree[column]) {
    for (Int h = p->first_half[row]; h != NONE; h = p->halves[h].next)
      if (p->halves[h].other == column) return h;
  } else {
    for (Int h = p->first_half[column]; h != NONE; h = p->halves[h].next)
      if (p->halves[h].other == row) return h ^ 1;
  }
  return NONE;
}

static Int entry(const Plan *p, Int row, Int column) {
  const Int h = half_of(p, row, column);
  return h == NONE ? p->zero : p->halves[h].entry;
}

static void append_half(Plan *p, Int h, Int row, Int other, Int register_, Int tie) {
  p->halves[h] = (Half){other, NONE, p->last_half[row], register_, tie};
  if (p->last_half[row] == NONE) p->first_half[row] = h;
  else p->halves[p->last_half[row]].next = h;
  p->last_half[row] = h;
  p->degree[row]++;
}

static void unlink_half(Plan *p, Int h, Int row) {
  const Half it = p->halves[h];
  if (it.before == NONE) p->first_half[row] = it.next;
  else p->halves[it.before].next = it.next;
  if (it.next == NONE) p->last_half[row] = it.before;
  else p->halves[it.next].before = it.before;
  p->degree[row]--;
}

/* Tie two rows; returns the half of the first. */
static Int put_edge(Plan *p, Int row, Int column, Int own, Int back, Int tie) {
  const Int h = p->half_count;
  p->half_count += 2;
  p->halves = larger(p, p->halves, &p->half_room, p->half_count, sizeof(Half));
  if (p->failed) return NONE;
  append_half(p, h, row, column, own, tie);
  append_half(p, h + 1, column, row, back, tie);
  return h;
}

static void add_entry(Plan *p, Int row, Int column, Int amount) {
  Int h = half_of(p, row, column);
  const Int total = added(p, h == NONE ? p->zero : p->halves[h].entry, amount);
  if (h == NONE) h = put_edge(p, row, column, total, p->zero, SEVERAL);
  if (p->failed) return;
  p->halves[h].entry = total;
  p->halves[h].tie = p->halves[h ^ 1].tie = SEVERAL;
  if (is_zero(p, total) && is_zero(p, p->halves[h ^ 1].entry)) {
    unlink_half(p, h, row);
    unlink_half(p, h ^ 1, column);
  }
}

static void remove_row(Plan *p, Int row) {
  for (Int h = p->first_half[row]; h != NONE; h = p->halves[h].next) unlink_half(p, h ^ 1, p->halves[h].other);
  p->gone[row] = 1;
}

static Int input_of(const Plan *p, Int source) {
  for (Int k = 0; k < p->input_count; k++)
    if (p->inputs[k] == source) return k;
  return NONE;
}

static void feed(Plan *p, Int row, Int source, Int amount) {
  const Int input = source == NONE ? NONE : input_of(p, source);
  if (input != NONE) put_drive(p, row, input, amount);
}

static void forget_network(Plan *p) {
  free(p->row_of), free(p->halves), free(p->terms), free(p->drives), free(p->heap), free(p->pivots);
  free(p->driving);
  p->row_of = p->pivots = NULL;
  p->halves = NULL, p->terms = NULL, p->drives = NULL, p->heap = NULL, p->driving = NULL;
  p->half_count = p->half_room = p->term_count = p->term_room = p->drive_count = p->drive_room = 0;
  p->heap_count = p->heap_room = p->pivot_count = p->pivot_room = 0;
}

static void set_network(Plan *p, Int root) {
  const Int j = p->junctions;
  forget_network(p);
  p->row_of = malloc(sizeof(Int) * 13 * (j + 1));
  p->driving = calloc(p->input_count + 1, 1);
  if (lacks(p, !p->row_of || !p->driving)) return;
  Int **arrays[12] = {&p->at, &p->depth, &p->first_half, &p->last_half, &p->degree, &p->first_term,
                      &p->last_term, &p->first_drive, &p->rank, &p->round, &p->gone, &p->by_rank};
  for (int k = 0; k < 12; k++) *arrays[k] = p->row_of + (k + 1) * (j + 1);
  for (Int k = 0; k < j; k++) p->row_of[k] = NONE;
  p->rows = 1;
  p->root = root;
  p->at[0] = root, p->row_of[root] = 0, p->depth[0] = 0;
  for (Int row = 0; row < p->rows; row++) { /* nearest first */
    const Int here = p->at[row];
    for (Int k = p->tied_start[here]; k < p->tied_start[here + 1]; k++) {
      const Coupling c = p->coupling[p->tied[k]];
      const Int other = c.tail == here ? c.head : c.tail;
      if (p->row_of[other] != NONE || p->fixing[other] != NONE) continue;
      p->row_of[other] = p->rows, p->depth[p->rows] = p->depth[row] + 1;
      p->at[p->rows++] = other;
    }
  }
  for (Int row = 0; row < p->rows; row++) {
    p->first_half[row] = p->last_half[row] = p->first_term[row] = p->last_term[row] = p->first_drive[row] = NONE;
    p->degree[row] = p->round[row] = p->gone[row] = p->rank[row] = 0;
  }
  for (Int row = 0; row < p->rows && !p->failed; row++) {
    const Int here = p->at[row];
    for (Int k = p->element_start[here]; k < p->element_start[here + 1]; k++) {
      const Int node = p->elements[k], type = p->types[node], value = parameter(p, node);
      const Int law = type == R_ ? value : times(p, p->s, value);
      stand(p, row, node, p->kind[here] == (type != C_) ? law : inverted(p, law), NONE);
    }
    for (Int k = p->feed_start[here]; k < p->feed_start[here + 1]; k++)
      feed(p, row, p->feeds[k], p->signs[k] > 0 ? p->one : negated(p, p->one));
  }
  for (Int k = 0; k < p->couplings && !p->failed; k++) {
    const Coupling c = p->coupling[k];
    const Int one = p->row_of[c.tail], other = p->row_of[c.head];
    if (one == NONE && other == NONE) continue;
    Int size = p->one, minus = negated(p, p->one);
    if (c.two_port != NONE) {
      size = parameter(p, c.two_port);
      size = c.inverse ? inverted(p, size) : size;
      minus = negated(p, size);
    }
    if (other == NONE) feed(p, one, p->fixing[c.head], minus);
    else if (one == NONE) feed(p, other, p->fixing[c.tail], size);
    else if (half_of(p, one, other) != NONE) {
      add_entry(p, one, other, size);
      add_entry(p, other, one, minus);
    } else {
      put_edge(p, one, other, size, minus, c.two_port == NONE ? BOND : 2 * c.two_port + c.inverse);
    }
  }
  for (Int row = 0; row < p->rows && !p->failed; row++)
    for (Int d = p->first_drive[row]; d != NONE; d = p->drives[d].next) p->driving[p->drives[d].source] = 1;
}

/* --- elimination --- */

static void put_pivot(Plan *p, Int register_) {
  p->pivots = larger(p, p->pivots, &p->pivot_room, p->pivot_count + 1, sizeof(Int));
  if (!p->failed) p->pivots[p->pivot_count++] = register_;
}

static void add_to(Plan *p, Int row, Int column, Int change, Int origin) {
  if (is_zero(p, change)) return;
  if (row != column) {
    add_entry(p, row, column, change);
    return;
  }
  Int before = NONE;
  for (Int t = p->first_term[row]; t != NONE; before = t, t = p->terms[t].next)
    if (p->terms[t].origin != NONE && are_opposite(p, p->terms[t].register_, change)) {
      if (before == NONE) p->first_term[row] = p->terms[t].next;
      else p->terms[before].next = p->terms[t].next;
      if (p->last_term[row] == t) p->last_term[row] = before;
      return;
    }
  stand(p, row, NONE - 1 - p->at[origin], change, p->at[origin]);
}

static Int name_of(const Plan *p, Int row) {
  const Int t = p->first_term[row];
  return t != NONE && p->terms[t].next == NONE ? p->terms[t].name : NONE - 1 - p->at[row];
}

static void transform_source(Plan *p, Int leaf, Int into, Int name, Int seen) {
  const Int factor = times(p, negated(p, entry(p, into, leaf)), seen);
  for (Int d = p->first_drive[leaf]; d != NONE; d = p->drives[d].next) {
    const Drive drive = p->drives[d];
    put_drive(p, into, drive.source, times(p, factor, drive.amount));
  }
  stand(p, into, name, seen, p->at[leaf]);
  remove_row(p, leaf);
}

static void reflect(Plan *p, Int leaf, Int into, Int own, Int tie) {
  const Int modulus = parameter(p, tie / 2), square = times(p, modulus, modulus);
  own = tie & 1 ? inverted(p, times(p, square, own)) : times(p, square, inverted(p, own));
  if (p->first_drive[leaf] == NONE) {
    stand(p, into, tie / 2, own, p->at[leaf]);
    remove_row(p, leaf);
    return;
  }
  const Int h = half_of(p, into, leaf), size = p->halves[h].entry;
  for (Int d = p->first_drive[leaf]; d != NONE; d = p->drives[d].next)
    p->drives[d].amount = divided(p, p->drives[d].amount, size);
  inverted(p, own); /* what stands on the leaf now */
  p->halves[h].entry = p->one, p->halves[h ^ 1].entry = negated(p, p->one);
  transform_source(p, leaf, into, tie / 2, own);
}

/* The neighbours of a row, which a caller frees. */
static Int *neighbours(Plan *p, Int row, Int *count) {
  Int n = 0, *made = malloc(sizeof(Int) * (p->degree[row] + 1));
  if (!lacks(p, !made))
    for (Int h = p->first_half[row]; h != NONE; h = p->halves[h].next) made[n++] = p->halves[h].other;
  *count = n;
  return made;
}

static void eliminate_on_loop(Plan *p, Int row, const Int *around, Int count, Int own) {
  const Int by = inverted(p, own);
  Int *factors = malloc(sizeof(Int) * (count + count * count + 1)), *changes = factors + count;
  if (lacks(p, !factors)) return;
  Int k = 0;
  for (Int h = p->first_half[row]; h != NONE; h = p->halves[h].next, k++)
    factors[k] = times(p, p->halves[h ^ 1].entry, by);
  for (Int i = 0; i < count; i++) {
    Int j = 0;
    for (Int h = p->first_half[row]; h != NONE; h = p->halves[h].next, j++)
      changes[i * count + j] = negated(p, times(p, factors[i], p->halves[h].entry));
  }
  for (Int i = 0; i < count && !p->failed; i++)
    for (Int j = 0; j < count && !p->failed; j++) add_to(p, around[i], around[j], changes[i * count + j], row);
  for (Int i = 0; i < count && !p->failed; i++)
    for (Int d = p->first_drive[row]; d != NONE && !p->failed; d = p->drives[d].next) {
      const Drive drive = p->drives[d];
      const Int minus = negated(p, factors[i]);
      put_drive(p, around[i], drive.source, times(p, minus, drive.amount));
    }
  remove_row(p, row);
  free(factors);
}

static void eliminate(Plan *p, Int row, const Int *around, Int count, Int own) {
  put_pivot(p, own);
  if (p->failed) return;
  if (!count) {
    remove_row(p, row);
    return;
  }
  const Int tie = count == 1 ? p->halves[p->first_half[row]].tie : SEVERAL;
  if (tie == SEVERAL) eliminate_on_loop(p, row, around, count, own);
  else if (tie >= 0) reflect(p, row, around[0], own, tie);
  else {
    const Int name = name_of(p, row), seen = inverted(p, own);
    if (p->first_drive[row] != NONE) transform_source(p, row, around[0], name, seen);
    else {
      stand(p, around[0], name, seen, p->at[row]);
      remove_row(p, row);
    }
  }
}

static int before(Turn a, Turn b) {
  if (a.round != b.round) return a.round < b.round;
  if (a.degree != b.degree) return a.degree < b.degree;
  return a.rank < b.rank;
}

static Turn turn_of(const Plan *p, Int row) {
  const Int degree = p->degree[row];
  return (Turn){degree > 1 ? p->round[row] : 0, degree, p->rank[row]};
}

static void push_turn(Plan *p, Int row) {
  p->heap = larger(p, p->heap, &p->heap_room, p->heap_count + 1, sizeof(Turn));
  if (p->failed) return;
  const Turn it = turn_of(p, row);
  Int at = p->heap_count++;
  for (; at && before(it, p->heap[(at - 1) / 2]); at = (at - 1) / 2) p->heap[at] = p->heap[(at - 1) / 2];
  p->heap[at] = it;
}

static Turn popped(Plan *p) {
  const Turn first = p->heap[0], last = p->heap[--p->heap_count];
  Int at = 0;
  for (;;) {
    Int next = 2 * at + 1;
    if (next >= p->heap_count) break;
    if (next + 1 < p->heap_count && before(p->heap[next + 1], p->heap[next])) next++;
    if (!before(p->heap[next], last)) break;
    p->heap[at] = p->heap[next];
    at = next;
  }
  p->heap[at] = last;
  return first;
}

static void eliminate_in_turn(Plan *p, Int most, int balanced) {
  while (p->heap_count && !p->failed) {
    const Turn turn = popped(p), now = turn_of(p, p->by_rank[turn.rank]);
    const Int row = p->by_rank[turn.rank];
    if (p->gone[row] || turn.round != now.round || turn.degree != now.degree) continue;
    const Int own = diagonal(p, row);
    if (is_zero(p, own)) {
      if (p->degree[row] != 1 || p->halves[p->first_half[row]].other == 0) continue;
      const Int h = p->first_half[row];
      if (!is_zero(p, p->halves[h].entry) && !is_zero(p, p->halves[h ^ 1].entry)) p->failed = REFUSED; /* a pair */
      continue;
    }
    Int count, *around = neighbours(p, row, &count);
    if (p->failed) return;
    eliminate(p, row, around, count, own);
    const Int following = balanced && count > 1 ? p->round[row] + 1 : 0;
    for (Int k = 0; k < count && !p->failed; k++) {
      const Int other = around[k];
      if (p->round[other] < following) p->round[other] = following;
      if (other && p->degree[other] <= most) push_turn(p, other);
    }
    free(around);
  }
}

/* --- entries --- */

static void forget(Plan *p) {
  forget_network(p);
  free(p->place), free(p->kind), free(p->coupling), free(p->element_start), free(p->values), free(p->ops);
  free(p->images), free(p->known), free(p->entry_list), free(p->compared), free((void *)p->types), free((void *)p->ends);
  free(p);
}

/* Make the junction structure of a graph, and a program without arithmetic. `above` and `below` are the values of
 * the nodes modulo the prime (any of those without), `general`: they are random. Fills sizes: junctions. Returns
 * the plan, or 0 where the graph has what is refused. */
ENTRY Int dynid_plan(Int nodes, Int bonds, const int8_t *types, const Int *ends, Int prime, Int general,
                     const Int *above, const Int *below, Int laplace, Int *sizes) {
  Plan *p = calloc(1, sizeof(Plan));
  if (!p) return NO_MEMORY;
  p->nodes = nodes, p->bonds = bonds, p->general = (int)general;
  set_prime(p, (uint64_t)prime);
  int8_t *own_types = malloc(nodes + 1);
  Int *own_ends = malloc(sizeof(Int) * (2 * bonds + 1));
  p->types = own_types, p->ends = own_ends;
  p->values = malloc(sizeof(Residue) * (nodes + 1));
  p->known_size = 1024, p->compared_size = 65536;
  p->known = malloc(sizeof(int32_t) * p->known_size);
  p->compared = malloc(sizeof(int32_t) * p->compared_size);
  if (!lacks(p, !own_types || !own_ends || !p->values || !p->known || !p->compared)) {
    memcpy(own_types, types, nodes);
    memcpy(own_ends, ends, sizeof(Int) * 2 * bonds);
    for (Int k = 0; k < nodes; k++) p->values[k] = (Residue){residue(p, above[k]), residue(p, below[k])};
    memset(p->known, -1, sizeof(int32_t) * p->known_size);
    memset(p->compared, -1, sizeof(int32_t) * p->compared_size);
    structure(p);
  }
  if (!p->failed) {
    p->zero = emit(p, (Operation){P_CONSTANT, 0, 0}, (Residue){0, p->unity});
    p->one = emit(p, (Operation){P_CONSTANT, 1, 0}, (Residue){p->unity, p->unity});
    p->s = emit(p, (Operation){P_LAPLACE, 0, 0}, (Residue){residue(p, laplace), p->unity});
  }
  if (p->failed) {
    const Int answer = p->memory ? NO_MEMORY : 0;
    forget(p);
    return answer;
  }
  sizes[0] = p->junctions;
  return (Int)p;
}

ENTRY Int dynid_plan_forget(Int plan) {
  forget((Plan *)plan);
  return 0;
}

/* Read the structure: the junction of every node (-1: none), and of every junction what fixes it (-1: nothing)
 * and its first node (-2 - bond of one that is not drawn). */
ENTRY Int dynid_plan_structure(Int plan, Int *place, Int *fixing, Int *drawn) {
  const Plan *p = (Plan *)plan;
  memcpy(place, p->place, sizeof(Int) * p->nodes);
  memcpy(fixing, p->fixing, sizeof(Int) * p->junctions);
  memcpy(drawn, p->drawn, sizeof(Int) * p->junctions);
  return 0;
}

/* Reduce to a junction. Fills sizes: rows, pivots, terms and drives of the root, elements there. Returns 1 where
 * it refuses. */
ENTRY Int dynid_plan_reduce(Int plan, Int root, Int input_count, const Int *inputs, Int balanced, Int *sizes) {
  Plan *p = (Plan *)plan;
  p->input_count = input_count, p->inputs = inputs;
  set_network(p, root);
  Int rank = 0;
  if (!p->failed) {
    for (Int end = p->rows; end > 0;) { /* the deepest first, those of one depth in their order */
      Int start = end - 1;
      while (start > 0 && p->depth[start - 1] == p->depth[end - 1]) start--;
      for (Int row = start; row < end; row++)
        if (row) p->rank[row] = rank, p->by_rank[rank++] = row;
      end = start;
    }
    for (Int k = 0; k < rank; k++)
      if (p->degree[p->by_rank[k]] < 2) push_turn(p, p->by_rank[k]);
    eliminate_in_turn(p, 1, (int)balanced);
    for (Int k = 0; k < rank && !p->failed; k++)
      if (!p->gone[p->by_rank[k]]) push_turn(p, p->by_rank[k]);
    if (!p->failed) eliminate_in_turn(p, rank, (int)balanced);
    for (Int row = 1; row < p->rows && !p->failed; row++) {
      if (p->gone[row]) continue;
      const Int own = diagonal(p, row);
      if (is_zero(p, own)) p->failed = REFUSED; /* bare to the end */
      Int count, *around = p->failed ? NULL : neighbours(p, row, &count);
      if (!p->failed) eliminate(p, row, around, count, own);
      free(around);
    }
  }
  if (p->failed) return p->memory ? NO_MEMORY : 1;
  Int terms = 0, drives = 0;
  for (Int t = p->first_term[0]; t != NONE; t = p->terms[t].next) terms++;
  for (Int d = p->first_drive[0]; d != NONE; d = p->drives[d].next) drives++;
  sizes[0] = p->rows, sizes[1] = p->pivot_count, sizes[2] = terms, sizes[3] = drives;
  sizes[4] = p->element_start[root + 1] - p->element_start[root];
  return 0;
}

/* Read what a reduction left: junctions (rows), pivots, terms (x 3: name, register, junction that left it),
 * drives (x 2: input, register) and elements (nodes) of the root, and the inputs that drive it (flags). */
ENTRY Int dynid_plan_reduced(Int plan, Int *junctions, Int *pivots, Int *terms, Int *drives, Int *elements,
                             uint8_t *driving) {
  const Plan *p = (Plan *)plan;
  memcpy(junctions, p->at, sizeof(Int) * p->rows);
  memcpy(pivots, p->pivots, sizeof(Int) * p->pivot_count);
  memcpy(driving, p->driving, p->input_count);
  for (Int t = p->first_term[0]; t != NONE; t = p->terms[t].next, terms += 3)
    terms[0] = p->terms[t].name, terms[1] = p->terms[t].register_, terms[2] = p->terms[t].origin;
  for (Int d = p->first_drive[0]; d != NONE; d = p->drives[d].next, drives += 2)
    drives[0] = p->drives[d].source, drives[1] = p->drives[d].amount;
  const Int first = p->element_start[p->root];
  memcpy(elements, p->elements + first, sizeof(Int) * (p->element_start[p->root + 1] - first));
  return 0;
}

/* Write an operation as `Program` does; returns its register, or -1 for a division by zero. */
ENTRY Int dynid_plan_write(Int plan, Int code, Int a, Int b) {
  Plan *p = (Plan *)plan;
  Int made = 0;
  switch (code) {
  case P_CONSTANT: {
    const Int rest = a % (Int)p->prime;
    made = emit(p, (Operation){P_CONSTANT, a, 0}, (Residue){residue(p, rest < 0 ? rest + (Int)p->prime : rest), p->unity});
    break;
  }
  case P_PARAMETER: made = parameter(p, a); break;
  case P_ADD: made = added(p, a, b); break;
  case P_SUB: made = subtracted(p, a, b); break;
  case P_MUL: made = times(p, a, b); break;
  case P_DIV: made = divided(p, a, b); break;
  default: made = negated(p, a);
  }
  if (p->memory) return NO_MEMORY;
  const int failed = p->failed;
  p->failed = 0;
  return failed ? -1 : made;
}

/* Return the image of a register. */
ENTRY Int dynid_plan_image(Int plan, Int register_) {
  const Plan *p = (Plan *)plan;
  const Residue x = p->images[register_];
  return (Int)residue_product(p, x.below == p->unity ? x.above : residue_product(p, x.above, inverse(p, x.below)), 1);
}

/* Return how many registers there are; where `codes` is given, read them. */
ENTRY Int dynid_plan_read(Int plan, Int *codes, Int *first, Int *second) {
  const Plan *p = (Plan *)plan;
  for (Int k = 0; codes && k < p->length; k++)
    codes[k] = p->ops[k].code, first[k] = p->ops[k].a, second[k] = p->ops[k].b;
  return p->length;
}

/* Return 1 if at another point, given as for `dynid_plan`, anything is divided by zero or one of the divisors is
 * zero. */
ENTRY Int dynid_plan_vanishes(Int plan, const Int *above, const Int *below, Int laplace, Int count,
                              const Int *divisors) {
  Plan *p = (Plan *)plan;
  Residue *x = malloc(sizeof(Residue) * p->length);
  if (!x) return NO_MEMORY;
  Int zero = 0;
  for (Int k = 0; k < p->length && !zero; k++) {
    const Operation op = p->ops[k];
    if (op.code >= P_ADD) {
      zero = op.code == P_DIV && !x[op.b].above;
      x[k] = computed(p, op.code, x[op.a], op.code == P_NEG ? x[op.a] : x[op.b]);
    } else if (op.code == P_CONSTANT) {
      x[k] = p->images[k];
    } else if (op.code == P_PARAMETER) {
      x[k] = (Residue){residue(p, above[op.a]), residue(p, below[op.a])};
    } else {
      x[k] = (Residue){residue(p, laplace), p->unity};
    }
  }
  for (Int k = 0; k < count && !zero; k++) zero = !x[divisors[k]].above;
  free(x);
  return zero;
}
