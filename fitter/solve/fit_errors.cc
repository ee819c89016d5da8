// Errors of a fit. Some effects depend on the arm's past, as on the warmth of a gear: the fit knows
// it from the rows before, while a prediction takes its average (is_foreseeable()).
#include "fitter/inference/cross_validation.h"
#include "fitter/solve/fit.h"

namespace armtrue {
namespace {

// Indices of the parameters that no prediction contains.
std::vector<int> unforeseen_in(const Design& design) {
  std::vector<int> result;
  const auto& parameters = design.model().parameters;
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    if (!is_foreseeable(parameters[i], design.state().robot().joint_count()))
      result.push_back(static_cast<int>(i));
  }
  return result;
}

// Those of its unknowns.
std::vector<Eigen::Index> unforeseen_unknowns(const Design& design) {
  std::vector<Eigen::Index> result;
  for (const int parameter : unforeseen_in(design)) {
    if (const int unknown = design.unknown_of(parameter); unknown >= 0) result.push_back(unknown);
  }
  return result;
}

// residual_distances() with these parameters at zero.
std::vector<double> distances_without(const std::vector<int>& parameters, Design& design) {
  const std::vector<double> fitted = design.values();
  std::vector<double> values = fitted;
  for (const int parameter : parameters) values[static_cast<std::size_t>(parameter)] = 0.0;
  design.set_values(values);
  std::vector<double> distances = residual_distances(design);
  design.set_values(fitted);
  return distances;
}

}  // namespace

void Fit::measure_errors() {
  const std::vector<double> distance = residual_distances(*design_);
  const std::vector<int> unforeseen = unforeseen_in(*design_);
  const std::vector<double> alone =
      unforeseen.empty() ? distance : distances_without(unforeseen, *design_);
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
  if (knows_history()) held_out_ = validate(unforeseen_unknowns(*design_));
}

void Fit::cross_validate() {
  if (options_.cross_validate) return;
  options_.cross_validate = true;
  predict_held_out(evaluate_rows(*design_));
}

bool Fit::knows_history() const { return !unforeseen_unknowns(*design_).empty(); }

}  // namespace armtrue
