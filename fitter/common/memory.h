// Keeps freed memory in the process, for the next allocations of a long computation.
#pragma once

namespace armtrue {

/// While an object of this class exists, memory that is freed stays with the process (glibc;
/// elsewhere without effect). A fit with tables builds hundreds of matrices of tens of megabytes.
/// By default the system supplies new pages for each of them and has to clear every page first.
class KeepsMemory {
 public:
  KeepsMemory();
  KeepsMemory(const KeepsMemory&) = delete;
  KeepsMemory& operator=(const KeepsMemory&) = delete;
  ~KeepsMemory();
};

}  // namespace armtrue
