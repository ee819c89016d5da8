#include "fitter/common/memory.h"

#include <climits>
#include <mutex>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace armtrue {
namespace {

std::mutex counting;
int standing = 0;

#ifdef __GLIBC__
// Defaults of glibc (mallopt(3)): most mapped blocks, and bytes that may stay unused.
constexpr int kDefaultMostMapped = 65536, kDefaultTrim = 128 * 1024;

void keep(bool kept) {
  mallopt(M_MMAP_MAX, kept ? 0 : kDefaultMostMapped);
  mallopt(M_TRIM_THRESHOLD, kept ? INT_MAX : kDefaultTrim);
  if (!kept) malloc_trim(0);
}
#else
void keep(bool) {}
#endif

}  // namespace

KeepsMemory::KeepsMemory() {
  const std::lock_guard lock(counting);
  if (standing++ == 0) keep(true);
}

KeepsMemory::~KeepsMemory() {
  const std::lock_guard lock(counting);
  if (--standing == 0) keep(false);
}

}  // namespace armtrue
