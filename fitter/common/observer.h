// Who watches a long computation: it is told how far that has come, and can have it stopped.
#pragma once

#include <atomic>
#include <exception>
#include <string>

namespace armtrue {

/// Is told how far a computation has come: by the thread that runs it, never by the workers of
/// in_parallel.
class Observer {
 public:
  Observer() = default;
  Observer(const Observer&) = delete;
  Observer& operator=(const Observer&) = delete;
  virtual ~Observer() = default;

  /// `share` is done, 0 to 1, of what `stage` says in words.
  virtual void report(double share, const std::string& stage) = 0;

  /// One that wants to know nothing.
  static Observer& none();
};

/// Thrown by throw_if_cancelled(). No ModelError: nothing that handles bad data may handle it.
class Cancelled final : public std::exception {
 public:
  const char* what() const noexcept override { return "cancelled"; }
};

/// While one stands, throw_if_cancelled() on this thread obeys its flag. in_parallel hands the flag
/// to its workers.
class CancelScope {
 public:
  /// `flag`: may be null, and outlives the scope.
  explicit CancelScope(const std::atomic<bool>* flag) : before_(current_) { current_ = flag; }
  CancelScope(const CancelScope&) = delete;
  CancelScope& operator=(const CancelScope&) = delete;
  ~CancelScope() { current_ = before_; }

  static const std::atomic<bool>* current() { return current_; }

 private:
  static thread_local const std::atomic<bool>* current_;
  const std::atomic<bool>* before_;
};

/// Stands in every loop that can last longer than people wait for Ctrl-C to be answered.
inline void throw_if_cancelled() {
  const std::atomic<bool>* flag = CancelScope::current();
  if (flag && flag->load(std::memory_order_relaxed)) throw Cancelled();
}

}  // namespace armtrue
