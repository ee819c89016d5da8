#include "fitter/design/load_feedback.h"

#include <algorithm>

#include "fitter/model/load_gradient.h"

namespace armtrue {
namespace {

// Each repetition leaves about a thousandth of the error: the arm's deflection in radians.
constexpr int kOrders = 2;

bool is_followed(const Variable& v) {
  return v.kind == VariableKind::kTorque || v.kind == VariableKind::kMoment ||
         v.kind == VariableKind::kBaseMoment;
}

}  // namespace

LoadFeedback::LoadFeedback(const Model& model, const CoordinateLayout& layout, const State& state)
    : layout_(layout) {
  if (!state.computes_torque()) return;
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    if (!model.parameters[p].exported) continue;
    for (const Term& term : model.parameters[p].terms) {
      for (const std::string& name : term.basis.variables()) {
        const auto load = parse_variable(name, layout.joints);
        if (term.table || !load || !is_followed(*load)) continue;
        auto found = std::ranges::find(loads_, name, &Variable::name);
        if (found == loads_.end()) found = loads_.insert(loads_.end(), *load);
        springs_.push_back({p,
                            static_cast<std::size_t>(found - loads_.begin()),
                            layout.index(term.coordinate),
                            term.weight,
                            term.basis,
                            {}});
      }
    }
  }
}

void LoadFeedback::update(const State& state, const Expression::Columns& columns,
                          const std::vector<Pose>& frames, std::vector<double> coordinates) {
  if (springs_.empty()) return;
  at_ = std::move(coordinates);
  for (Spring& spring : springs_)
    spring.slope = spring.basis.slopes(state.rows(), columns, loads_[spring.load].name);
  const auto width = static_cast<std::size_t>(layout_.size());
  const auto each = static_cast<std::size_t>(layout_.joints) + 1;
  gradient_.resize(state.rows() * loads_.size() * width);
  const std::vector<double>* payload = state.has("payload") ? &state.column("payload") : nullptr;
  for (std::size_t row = 0; row < state.rows(); ++row) {
    const LoadGradient gradient(state.robot(), layout_, frames.data() + row * each,
                                payload ? (*payload)[row] : 0.0);
    for (std::size_t l = 0; l < loads_.size(); ++l) {
      gradient.of(loads_[l],
                  Eigen::Map<Eigen::RowVectorXd>(
                      gradient_.data() + (row * loads_.size() + l) * width, layout_.size()));
    }
  }
}

LoadFeedback::Gradients LoadFeedback::gradients(std::size_t row) const {
  const auto width = static_cast<std::size_t>(layout_.size());
  return {gradient_.data() + row * loads_.size() * width, static_cast<Eigen::Index>(loads_.size()),
          layout_.size()};
}

void LoadFeedback::correct(std::size_t row, const std::vector<double>& values,
                           const Eigen::VectorXd& arm, Eigen::VectorXd& coordinates) const {
  const Eigen::Map<const Eigen::VectorXd> before(
      at_.data() + row * static_cast<std::size_t>(layout_.size()), layout_.size());
  const Gradients gradient = gradients(row);
  Eigen::VectorXd bent = Eigen::VectorXd::Zero(layout_.size());
  for (int order = 0; order < kOrders; ++order) {
    const Eigen::VectorXd load = gradient * (arm + bent - before);
    bent.setZero();
    for (const Spring& s : springs_)
      bent[s.coordinate] +=
          values[s.parameter] * s.weight * s.slope[row] * load[static_cast<Eigen::Index>(s.load)];
  }
  coordinates += bent;
}

void LoadFeedback::follow(std::size_t row, const std::vector<double>& values,
                          Eigen::Matrix<double, 6, Eigen::Dynamic>& jacobian) const {
  const Gradients gradient = gradients(row);
  Eigen::Matrix<double, 6, Eigen::Dynamic> by_load(6, gradient.rows());
  const Eigen::Matrix<double, 6, Eigen::Dynamic> direct = jacobian;
  for (int order = 0; order < kOrders; ++order) {
    by_load.setZero();
    for (const Spring& s : springs_) {
      by_load.col(static_cast<Eigen::Index>(s.load)) +=
          values[s.parameter] * s.weight * s.slope[row] * jacobian.col(s.coordinate);
    }
    jacobian = direct;
    jacobian.noalias() += by_load * gradient;
  }
}

}  // namespace armtrue
