#include "fitter/design/stance.h"

#include <algorithm>
#include <functional>
#include <limits>

#include "fitter/common/observer.h"

namespace armtrue {
namespace {

// Each round leaves about a thousandth of the change: the arm's deflection in radians.
constexpr int kMostRounds = 30;
constexpr double kStandsStill = 1e-12;  // [m and rad]

// Frames of all rows in the robot base: those of the joints, then the payload point's.
class Stance {
 public:
  Stance(const State& state, const Model& model, const std::vector<double>& values,
         const Kinematics& kinematics)
      : state_(state),
        values_(values),
        chain_(kinematics),
        coordinates_(Eigen::VectorXd::Zero(kinematics.layout().size())) {
    chain_.set_base(Pose::Identity());
    for (int t = 0; t < chain_.targets(); ++t) chain_.set_tool(t, Pose::Identity());
    for (std::size_t p = 0; p < values_.size(); ++p) {
      if (!model.parameters[p].exported) values_[p] = 0.0;
    }
  }

  std::vector<Pose> frames(const BasisTable& basis) {
    const CoordinateLayout& layout = chain_.layout();
    const auto n = static_cast<std::size_t>(layout.joints);
    const Eigen::Translation3d payload(state_.payload_point());
    std::vector<Pose> result;
    result.reserve(state_.rows() * (n + 1));
    coordinates_of_rows_.clear();
    for (std::size_t i = 0; i < state_.rows(); ++i) {
      throw_if_cancelled();
      basis.row(i, entries_);
      coordinates_.setZero();
      for (const BasisTable::Entry& e : entries_)
        coordinates_[e.coordinate] += values_[static_cast<std::size_t>(e.parameter)] * e.value;
      // The payload point is fixed to the flange, wherever the tool is. Without masses, sums of
      // mass moments are fitted. They hold at all joint angles, but not for links that bend in
      // other directions, so the coordinates of links and base are zeroed.
      const Eigen::Index followed =
          state_.computes_torque() ? layout.tool(0, 0) : Eigen::Index{layout.joints};
      coordinates_.tail(layout.size() - followed).setZero();
      coordinates_of_rows_.insert(coordinates_of_rows_.end(), coordinates_.begin(),
                                  coordinates_.end());
      const Pose flange = chain_.forward(&state_.joints()[i * n], coordinates_.data(), 0);
      result.insert(result.end(), chain_.frames().begin(), chain_.frames().end());
      result.push_back(flange * payload);
    }
    return result;
  }

  /// Of the last call of `frames`, rows × coordinates.
  const std::vector<double>& coordinates() const { return coordinates_of_rows_; }

  // Largest distance between frames [m, and rad at 1 m].
  static double distance(const std::vector<Pose>& a, const std::vector<Pose>& b) {
    double largest = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i)
      largest = std::max(largest, (a[i].matrix() - b[i].matrix()).norm());
    return largest;
  }

 private:
  const State& state_;
  std::vector<double> values_;
  std::vector<double> coordinates_of_rows_;
  Kinematics chain_;
  Eigen::VectorXd coordinates_;
  std::vector<BasisTable::Entry> entries_;
};

}  // namespace

double stand(State& state, BasisTable& basis, const Model& model, const std::vector<double>& values,
             const Kinematics& kinematics, LoadFeedback* feedback) {
  if (!basis.reads_loads()) return 0.0;
  if (!state.loads_follow()) {
    basis.update_loads();
    if (feedback) feedback->clear();
    return 0.0;
  }
  Stance stance(state, model, values, kinematics);
  const std::vector<Pose> first = stance.frames(basis);
  std::vector<Pose> here = first;
  double last = std::numeric_limits<double>::infinity();
  for (int round = 0; round < kMostRounds; ++round) {
    state.stand(here);
    basis.update_loads();
    std::vector<Pose> next = stance.frames(basis);
    const double moved = Stance::distance(here, next);
    // No real arm is so soft that this diverges: its loads then stay those of the first round.
    if (!(moved < last) && moved > kStandsStill) {
      here = first;
      state.stand(here);
      basis.update_loads();
      break;
    }
    last = moved;
    here = std::move(next);
    if (moved < kStandsStill) break;
  }
  if (feedback) {
    feedback->update(state, std::bind_front(&BasisTable::column, &basis), here,
                     stance.coordinates());
  }
  return Stance::distance(first, here);
}

void stand(State& state, const Model& model, const Kinematics& kinematics) {
  BasisTable basis(model, state, kinematics.layout());
  std::vector<double> values;
  for (const Parameter& p : model.parameters) values.push_back(p.value);
  stand(state, basis, model, values, kinematics);
}

}  // namespace armtrue
