#include "fitter/solve/history.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "fitter/common/parallel.h"
#include "fitter/solve/fit.h"

namespace armtrue {
namespace {

// The fit without one fold: a Gauss–Newton step from the full solution, as in held_out_distances().
Eigen::VectorXd step_without(const std::vector<const Design::Row*>& fold, const Design& design,
                             const NormalEquations& total) {
  NormalEquations own(design.unknowns());
  own.add(fold, design.residuals_per_row());
  own.information = total.information - own.information;
  const ScaledCholesky factor(std::move(own.information));
  return -factor.solve(total.gradient - own.gradient);
}

}  // namespace

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

CrossValidation cross_validate_without(const Unforeseen& unforeseen, const CrossValidation& known,
                                       const Design& design, const EvaluatedRows& evaluated,
                                       int folds, std::uint64_t seed, double smoothness_sigma) {
  NormalEquations total = accumulate(design, evaluated);
  const std::vector<double> present = design.unknown_values();
  for (const PenaltyRow& penalty : penalty_rows(design, smoothness_sigma))
    total.add(penalty, present);
  CrossValidation result = known;
  for (const Folding folding : {Folding::kRandom, Folding::kTime, Folding::kRegion}) {
    const auto f = static_cast<std::size_t>(folding);
    const std::vector<int> fold_of_row = make_folds(design, folding, folds, seed);
    in_parallel(static_cast<std::size_t>(folds), [&](std::size_t fold) {
      std::vector<std::size_t> rows;
      std::vector<const Design::Row*> own;
      for (std::size_t r = 0; r < evaluated.rows.size(); ++r) {
        if (fold_of_row[evaluated.index[r]] != static_cast<int>(fold)) continue;
        rows.push_back(r);
        own.push_back(&evaluated.rows[r]);
      }
      Eigen::VectorXd change = step_without(own, design, total);
      for (const Eigen::Index u : unforeseen.unknowns)
        change[u] = -present[static_cast<std::size_t>(u)];
      for (const std::size_t r : rows) {
        double& distance = result.distances[f][evaluated.index[r]];
        if (!std::isfinite(distance)) continue;
        const Design::Row& row = evaluated.rows[r];
        Eigen::Vector3d error = row.residual.head<3>();
        for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
          error +=
              row.jacobian.block<3, 1>(0, static_cast<Eigen::Index>(u)) * change[row.unknowns[u]];
        }
        const std::size_t i = evaluated.index[r];
        const Eigen::Matrix3d whiten =
            std::sqrt(design.weights()[i]) * design.measurements().whiten_position[i];
        distance = (whiten.inverse() * error).norm();
      }
    });
    result.errors[f] = summarise_finite(result.distances[f]);
  }
  return result;
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
  held_out_with_history_ = held_out_ = armtrue::cross_validate(*design_, evaluated, options_.folds,
                                                               options_.seed, smoothness_.sigma);
  const Unforeseen unforeseen = unforeseen_in(*design_);
  if (unforeseen.unknowns.empty()) return;
  held_out_ = cross_validate_without(unforeseen, held_out_with_history_, *design_, evaluated,
                                     options_.folds, options_.seed, smoothness_.sigma);
}

void Fit::cross_validate() {
  if (options_.cross_validate) return;
  options_.cross_validate = true;
  predict_held_out(evaluate_rows(*design_));
}

bool Fit::knows_history() const { return !unforeseen_in(*design_).unknowns.empty(); }

}  // namespace armtrue
