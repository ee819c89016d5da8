// Progress reports of a long computation, and its cancellation.
#pragma once

#include <atomic>
#include <exception>
#include <string>

namespace armtrue {

/// Receives progress reports, always from the thread that runs the computation, never from the
/// workers of in_parallel. This class ignores them; derived classes show them.
class Observer {
 public:
  Observer() = default;
  Observer(const Observer&) = delete;
  Observer& operator=(const Observer&) = delete;
  virtual ~Observer() = default;

  /// `share` done so far, 0 to 1, and the current `step`, in words.
  virtual void report(double /*share*/, const std::string& /*step*/) {}

  /// For a computation whose progress nobody watches.
  static Observer& none();
};

/// Thrown by throw_if_cancelled(). Not a ModelError, so that handlers of bad data do not catch it.
class Cancelled final : public std::exception {
 public:
  const char* what() const noexcept override { return "cancelled"; }
};

/// While an object of this class exists, throw_if_cancelled() on this thread obeys its flag.
/// in_parallel hands the flag to its workers.
class CancelScope {
 public:
  /// `flag`: may be null; must outlive the scope.
  explicit CancelScope(const std::atomic<bool>* flag) : before_(current_) { current_ = flag; }
  CancelScope(const CancelScope&) = delete;
  CancelScope& operator=(const CancelScope&) = delete;
  ~CancelScope() { current_ = before_; }

  static const std::atomic<bool>* current() { return current_; }

 private:
  static thread_local const std::atomic<bool>* current_;
  const std::atomic<bool>* before_;
};

/// Called in every loop that can last longer than a user waits for Ctrl-C to take effect.
inline void throw_if_cancelled() {
  const std::atomic<bool>* flag = CancelScope::current();
  if (flag && flag->load(std::memory_order_relaxed)) throw Cancelled();
}

}  // namespace armtrue
