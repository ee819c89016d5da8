#include "fitter/solve/history.h"

#include "fitter/solve/fit.h"

namespace armtrue {

Unforeseen unforeseen_in(const Design& design) {
  Unforeseen result;
  const auto& parameters = design.model().parameters;
  const int joints = design.state().robot().joint_count();
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    if (is_foreseeable(parameters[i], joints)) continue;
    result.parameters.push_back(static_cast<int>(i));
    if (const int unknown = design.unknown_of(static_cast<int>(i)); unknown >= 0)
      result.unknowns.push_back(unknown);
  }
  return result;
}

std::vector<double> distances_without(const Unforeseen& unforeseen, Design& design) {
  const std::vector<double> fitted = design.values();
  std::vector<double> values = fitted;
  for (const int parameter : unforeseen.parameters)
    values[static_cast<std::size_t>(parameter)] = 0.0;
  design.set_values(values);
  std::vector<double> distances = residual_distances(design);
  design.set_values(fitted);
  return distances;
}

void Fit::measure_errors() {
  const std::vector<double> distance = residual_distances(*design_);
  const Unforeseen unforeseen = unforeseen_in(*design_);
  const std::vector<double> alone =
      unforeseen.parameters.empty() ? distance : distances_without(unforeseen, *design_);
  std::vector<double> kept, kept_alone;
  for (std::size_t i = 0; i < distance.size(); ++i) {
    if (design_->weights()[i] == 0.0) continue;
    kept.push_back(distance[i]);
    kept_alone.push_back(alone[i]);
  }
  train_ = summarise(kept_alone);
  train_with_history_ = summarise(kept);
  for (RejectedRow& r : rejected_) r.residual = distance[r.row];
}

void Fit::predict_held_out(const EvaluatedRows& evaluated) {
  const auto validate = [&](const std::vector<Eigen::Index>& unforeseen) {
    return armtrue::cross_validate(*design_, evaluated, options_.folds, options_.seed,
                                   smoothness_.sigma, unforeseen);
  };
  held_out_with_history_ = held_out_ = validate({});
  const Unforeseen unforeseen = unforeseen_in(*design_);
  if (!unforeseen.unknowns.empty()) held_out_ = validate(unforeseen.unknowns);
}

void Fit::cross_validate() {
  if (options_.cross_validate) return;
  options_.cross_validate = true;
  predict_held_out(evaluate_rows(*design_));
}

bool Fit::knows_history() const { return !unforeseen_in(*design_).unknowns.empty(); }

}  // namespace armtrue
