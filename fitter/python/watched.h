// Long calls from Python: a thread of their own computes, without the GIL, while the calling thread
// passes progress to Python and handles Ctrl-C.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "fitter/common/observer.h"

namespace armtrue {

using Progress = std::function<void(double, const std::string&)>;

/// Communication between the computing thread and the thread that called from Python.
class WatchedCall final : public Observer {
 public:
  /// `progress`: called on the caller's thread only, with the GIL.
  explicit WatchedCall(std::optional<Progress> progress) : progress_(std::move(progress)) {}

  void report(double share, const std::string& stage) override;
  /// Runs `task` on the caller's thread with the GIL, and waits for it. Throws Cancelled if the
  /// call is cancelled meanwhile.
  void on_callers_thread(const std::function<void()>& task);

  /// Called with the GIL. Returns when `work` has ended; throws what `work`, a callback or Ctrl-C's
  /// handler threw.
  void run(const std::function<void()>& work);

 private:
  struct Task {
    std::function<void()> run;
    bool* done = nullptr;  // set when the task has run; nullptr: no thread waits
  };
  void attend();
  bool wait_for_task(Task& task);

  const std::optional<Progress> progress_;
  std::atomic<bool> cancelled_ = false;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Task> tasks_;
  bool ended_ = false;
};

/// Runs `work(call)` as WatchedCall::run does; returns its result.
template <typename Work>
auto watched(std::optional<Progress> progress, const Work& work) {
  WatchedCall call(std::move(progress));
  std::optional<decltype(work(call))> result;
  call.run([&] { result.emplace(work(call)); });
  return std::move(*result);
}

}  // namespace armtrue
