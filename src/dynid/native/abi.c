#include "products.h"
#if defined(__GLIBC__)
#include <malloc.h>
#endif
#if defined(__x86_64__)
#include <cpuid.h>
#endif

/* The version of the functions' arguments, as in `__init__.py`. */
ENTRY int64_t dynid_abi(void) { return 12; }

/* Return 1 if this machine has registers of 256 bits and fused multiply-adds, and its system keeps them; 2 if it
 * has them of 512 bits as well. */
ENTRY int64_t dynid_wide(void) {
#if defined(__x86_64__)
  unsigned a, b, c, d;
  if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_FMA) || !(c & bit_OSXSAVE)) return 0;
  __asm__("xgetbv" : "=a"(a), "=d"(d) : "c"(0));
  const unsigned kept = a, wanted = bit_AVX512F | bit_AVX512DQ | bit_AVX512VL;
  if ((kept & 6) != 6 || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & bit_AVX2)) return 0;
  return (kept & 0xe0) == 0xe0 && (b & wanted) == wanted ? 2 : 1;
#else
  return 0;
#endif
}

/* Keep so many bytes that were freed for later arrays of this process. Otherwise the C library of Linux returns
 * them to the system, which clears every page again for the next array: a tenth of the time of small samples. */
ENTRY int64_t dynid_keep_memory(int64_t bytes) {
#if defined(__GLIBC__)
  mallopt(M_MMAP_THRESHOLD, (int)(bytes / 2));
  mallopt(M_TRIM_THRESHOLD, (int)bytes);
#endif
  return bytes;
}
