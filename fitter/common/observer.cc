#include "fitter/common/observer.h"

namespace armtrue {
namespace {

class NoObserver final : public Observer {
 public:
  void report(double, const std::string&) override {}
};

}  // namespace

thread_local const std::atomic<bool>* CancelScope::current_ = nullptr;

Observer& Observer::none() {
  static NoObserver observer;
  return observer;
}

}  // namespace armtrue
