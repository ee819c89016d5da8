// Keeps what a long computation frees for what it needs next.
#pragma once

namespace armtrue {

/// While one stands, memory that is freed stays with the process (glibc; elsewhere without effect).
/// A fit with tables builds matrices of tens of megabytes by the hundred. By default each comes
/// fresh from the system, which has to clear every page of it first.
class KeepsMemory {
 public:
  KeepsMemory();
  KeepsMemory(const KeepsMemory&) = delete;
  KeepsMemory& operator=(const KeepsMemory&) = delete;
  ~KeepsMemory();
};

}  // namespace armtrue
