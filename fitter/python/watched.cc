#include "fitter/python/watched.h"

#include <climits>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace nb = nanobind;

namespace armtrue {
namespace {

// Longest delay before Ctrl-C is noticed.
constexpr std::chrono::milliseconds kBetweenLooks{50};

// While an object of this class exists, memory that is freed stays with the process (glibc;
// elsewhere without effect). A fit with tables builds hundreds of matrices of tens of megabytes. By
// default the system supplies new pages for each of them and has to clear every page first.
class KeepsMemory {
 public:
  KeepsMemory() { change(1); }
  KeepsMemory(const KeepsMemory&) = delete;
  KeepsMemory& operator=(const KeepsMemory&) = delete;
  ~KeepsMemory() { change(-1); }

 private:
  static void change([[maybe_unused]] int by) {
#ifdef __GLIBC__
    // Defaults of glibc (mallopt(3)): most mapped blocks, and bytes that may stay unused.
    constexpr int kDefaultMostMapped = 65536, kDefaultTrim = 128 * 1024;
    static std::mutex counting;
    static int standing = 0;
    const std::lock_guard lock(counting);
    standing += by;
    mallopt(M_MMAP_MAX, standing > 0 ? 0 : kDefaultMostMapped);
    mallopt(M_TRIM_THRESHOLD, standing > 0 ? INT_MAX : kDefaultTrim);
    if (standing == 0) malloc_trim(0);
#endif
  }
};

}  // namespace

void WatchedCall::report(double share, const std::string& stage) {
  if (!progress_) return;
  const std::lock_guard lock(mutex_);
  tasks_.push_back({[this, share, stage] { (*progress_)(share, stage); }});
  changed_.notify_all();
}

void WatchedCall::on_callers_thread(const std::function<void()>& task) {
  bool done = false;
  std::unique_lock lock(mutex_);
  tasks_.push_back({task, &done});
  changed_.notify_all();
  changed_.wait(lock, [&] { return done || cancelled_; });
  if (cancelled_) throw Cancelled();
}

// Waits at most kBetweenLooks for a task, without the GIL. Returns false if none came.
bool WatchedCall::wait_for_task(Task& task) {
  const nb::gil_scoped_release released;
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, kBetweenLooks, [&] { return ended_ || !tasks_.empty(); });
  if (tasks_.empty()) return false;
  task = std::move(tasks_.front());
  tasks_.pop_front();
  return true;
}

// Runs the tasks of the computing thread on this one, until the computation has ended.
void WatchedCall::attend() {
  for (;;) {
    Task task;
    const bool found = wait_for_task(task);
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (found) task.run();
    const std::lock_guard lock(mutex_);
    if (task.done) {
      *task.done = true;
      changed_.notify_all();
    }
    if (ended_ && tasks_.empty()) return;
  }
}

void WatchedCall::run(const std::function<void()>& work) {
  std::exception_ptr failure;
  std::thread computing([&] {
    const CancelScope scope(&cancelled_);
    const KeepsMemory memory;
    try {
      work();
    } catch (...) {
      failure = std::current_exception();
    }
    const std::lock_guard lock(mutex_);
    ended_ = true;
    changed_.notify_all();
  });
  std::exception_ptr stopped_by;
  try {
    attend();
  } catch (...) {
    stopped_by = std::current_exception();
    const std::lock_guard lock(mutex_);
    cancelled_ = true;
    changed_.notify_all();
  }
  {
    const nb::gil_scoped_release released;
    computing.join();
  }
  if (stopped_by) std::rethrow_exception(stopped_by);
  if (failure) std::rethrow_exception(failure);
}

}  // namespace armtrue
