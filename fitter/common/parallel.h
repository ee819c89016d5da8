// Runs independent jobs on all processors.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>
#include <utility>
#include <vector>

#include "fitter/common/observer.h"

namespace armtrue {

/// True on a thread of in_parallel: all processors are in use.
inline bool& is_one_of_many() {
  static thread_local bool value = false;
  return value;
}

/// Number of threads that in_parallel would use; 1 if called from one of its jobs.
inline std::size_t processors() {
  return is_one_of_many() ? 1U : std::max(1U, std::thread::hardware_concurrency());
}

/// Calls `job(index)` once for each index below `count`, on as many threads as there are
/// processors, the caller's included. A call from within a job runs on the caller's thread alone.
/// Jobs must not share data that they change. The first exception is rethrown when all threads have
/// ended; jobs that had not begun by then are not run. The caller's CancelScope applies to all
/// threads.
template <typename Job>
void in_parallel(std::size_t count, const Job& job) {
  const std::size_t workers = std::min(count, processors());
  if (workers <= 1) {
    for (std::size_t index = 0; index < count; ++index) {
      throw_if_cancelled();
      job(index);
    }
    return;
  }
  std::atomic<std::size_t> next = 0;
  std::vector<std::exception_ptr> failures(workers);
  const std::atomic<bool>* cancelled = CancelScope::current();
  const auto work = [&](std::size_t worker) {
    const CancelScope scope(cancelled);
    const bool before = std::exchange(is_one_of_many(), true);
    try {
      for (std::size_t index = next++; index < count; index = next++) {
        throw_if_cancelled();
        job(index);
      }
    } catch (...) {
      failures[worker] = std::current_exception();
      next = count;
    }
    is_one_of_many() = before;
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t worker = 1; worker < workers; ++worker) others.emplace_back(work, worker);
    work(0);
  }
  for (const std::exception_ptr& failure : failures) {
    if (failure) std::rethrow_exception(failure);
  }
}

/// Divides `count` indices into consecutive pieces of `together` (the last may be shorter) and
/// calls `job(first, end)` for each by in_parallel: for jobs that are too short to run one by one.
template <typename Count, typename Job>
void in_pieces(Count count, Count together, const Job& job) {
  const auto pieces = static_cast<std::size_t>((count + together - 1) / together);
  in_parallel(pieces, [&](std::size_t piece) {
    const Count first = static_cast<Count>(piece) * together;
    job(first, std::min(count, first + together));
  });
}

}  // namespace armtrue
