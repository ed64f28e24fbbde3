#include "products.h"

/* The version of the functions' arguments, as in `__init__.py`. */
ENTRY int64_t dynid_abi(void) { return 2; }

/* Return 1 if this machine has wide registers and fused multiply-adds. */
ENTRY int64_t dynid_wide(void) {
#if defined(__x86_64__)
  __builtin_cpu_init();
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
  return 0;
#endif
}
