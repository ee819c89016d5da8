// Terms proportional to a load that other terms of the same model carry: products of coefficients.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "fitter/design/model.h"

namespace armtrue {

/// Which parameters carry loads (a balancer's torque), and which terms are proportional to such a
/// load (the balancer's seal friction). Until `begin`, the terms keep the load of their basis: a
/// fit begins with coefficients of zero, which carry none.
class CarriedLoads {
 public:
  /// `ratio`: weight · basis / load, by row.
  struct Follower {
    std::size_t parameter, load;
    int coordinate;
    std::vector<double> ratio;
  };

  CarriedLoads(const Model& model, const CoordinateLayout& layout, const State& state);

  std::size_t loads() const { return loads_; }
  /// The terms follow the present coefficients from now on. Returns false if they did before, or if
  /// there are none.
  bool begin() { return !followers_.empty() && !std::exchange(has_begun_, true); }
  std::span<const Follower> followers() const {
    return has_begun_ ? std::span(followers_) : std::span<const Follower>();
  }
  /// The load that a parameter carries and terms follow; −1: none.
  int load_of(std::size_t parameter) const { return has_begun_ ? load_of_[parameter] : -1; }
  /// Whether the parameter's terms follow a load.
  bool follows(std::size_t parameter) const { return has_begun_ && follows_[parameter]; }

 private:
  bool has_begun_ = false;
  std::size_t loads_ = 0;
  std::vector<int> load_of_;
  std::vector<bool> follows_;
  std::vector<Follower> followers_;
};

}  // namespace armtrue
