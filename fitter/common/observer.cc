#include "fitter/common/observer.h"

namespace armtrue {
thread_local const std::atomic<bool>* CancelScope::current_ = nullptr;

Observer& Observer::none() {
  static Observer observer;
  return observer;
}

}  // namespace armtrue
