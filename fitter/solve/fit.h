// From measurements to a fitted model: alignment, identifiability, solution, gross errors,
// covariance, held-out errors.
#pragma once

#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fitter/common/observer.h"
#include "fitter/design/normal_equations.h"
#include "fitter/inference/cross_validation.h"
#include "fitter/inference/identifiability.h"
#include "fitter/inference/noise_floor.h"
#include "fitter/inference/smoothness.h"
#include "fitter/inference/uncertainty.h"
#include "fitter/solve/least_squares.h"
#include "fitter/start/prepared.h"

namespace armtrue {

/// Result of a fit, from which the next fit to the same measurements can start.
struct StartPoint {
  std::shared_ptr<const Prepared> prepared;
  std::map<std::string, double> values;  ///< of linear parameters, by name
  Pose measuring_from_base = Pose::Identity();
  std::vector<Pose> flange_from_tool;  ///< by target
  std::vector<Spring> springs{};
  std::map<std::string, Expression> carried{};
  std::shared_ptr<const State> state{};  ///< with the loads of that fit's deflected arm
  Smoothness smoothness{0.0, 0.0, {}};   ///< of tables; sigma is 0 if the model has none
  double orientation_inflation = 1.0;    ///< of the standard deviation of orientations
  double noise_scale = 1.0;              ///< factor on the stated standard deviation of a reading
  double sigma_rotation = 0.0;           ///< [rad] standard deviation of a measured orientation
  std::vector<double> weights{};         ///< of rows: 0 for gross errors
  double effective_unknowns = 0.0;       ///< without those that priors and smoothness determine
  int unknowns_beside_tables = 0;
  std::map<std::string, std::map<double, double>> tables{};  ///< 1-D tables by id: value by node
};

struct FitOptions {
  int folds = 5;
  std::uint64_t seed = 0;
  double assumed_sigma =
      10e-6;  ///< [m] if no column, instrument or repeats tell it; matters only beside priors
  double sigma_rotation = 20e-6;  ///< [rad] of measured orientations
  bool reject_gross_errors = true;
  bool cross_validate = true;
  std::optional<Instrument> instrument;
  std::optional<double> smoothness_sigma;  ///< of tables; none: chosen from the data
  /// Where nonlinear parameters start, by name; those without one are searched for.
  std::map<std::string, double> nonlinear_starts;
  /// Values of nonlinear parameters that are tried beside their own starts.
  std::map<std::string, double> nonlinear_guesses;
  /// Values at which linear parameters start; none: nominal. A fit that searches for nonlinear
  /// parameters starts at nominal in any case.
  std::shared_ptr<const StartPoint> start;
  /// Smoothness of tables and the weight of orientations are taken from `start`, and gross errors
  /// sought once, at the end: for steps between two full fits. Without effect if `start` lacks a
  /// table node of the model, or if nonlinear parameters are searched for.
  bool keeps_weights = false;
};

struct RejectedRow {
  std::size_t row = 0;    ///< 0-based
  double residual = 0.0;  ///< [m]
};

/// A fitted model with its statistics. Holds its own copies of what it was fitted to.
class Fit {
 public:
  /// Throws ModelError if the data do not suffice for the model.
  static std::unique_ptr<Fit> run(const Robot& robot, const State::Columns& columns,
                                  const ModelSpecification& specification,
                                  const FitOptions& options, Observer& observer = Observer::none());

  const Robot& robot() const { return prepared_->robot; }
  /// Alignment::first_from_set_up; measurements are in the first set-up's frame.
  const std::map<int, Pose>& first_from_set_up() const {
    return prepared_->alignment.first_from_set_up;
  }
  /// Loads are those of the deflected fitted arm, or of the nominal arm at commanded angles if the
  /// data prefer these.
  const State& state() const { return *state_; }
  const Measurements& measurements() const { return measurements_; }
  const Model& model() const { return model_; }
  const ModelSpecification& specification() const { return specification_; }
  const FitOptions& options() const { return options_; }
  Design& design() { return *design_; }
  const Design& design() const { return *design_; }
  const Kinematics& kinematics() const { return *kinematics_; }
  const EffectContext& context() const { return *context_; }
  /// Whether smoothness and the weight of orientations come from another fit.
  bool kept_weights() const { return kept_weights_; }
  double smoothness_sigma() const { return smoothness_.sigma; }
  /// Factor between the stated and the observed standard deviation of a measurement.
  double noise_scale() const { return noise_scale_; }
  const NoiseFloor& noise_floor() const { return noise_floor_; }
  const std::vector<RejectedRow>& rejected() const { return rejected_; }
  /// Covariance of the design's unknowns, computed at each call.
  Eigen::MatrixXd covariance() const;
  /// Errors of predictions that use nothing but the row itself, as those of `predict` do.
  const ErrorSummary& train_error() const { return train_; }
  const ErrorSummary& nominal_error() const { return nominal_; }
  const ErrorSummary& held_out_error() const { return held_out_.errors[0]; }
  /// Held out at random, by time, by region.
  const std::vector<ErrorSummary>& held_out_errors() const { return held_out_.errors; }
  /// Whether the model has effects of the arm's past (self_heating), which no prediction knows.
  bool knows_history() const;
  /// The errors that predictions would have if they knew the arm's past as the measurements do.
  /// They judge the model; without such effects they are those above.
  const ErrorSummary& train_error_with_history() const { return train_with_history_; }
  const CrossValidation& held_out_with_history() const { return held_out_with_history_; }
  double effective_unknowns() const { return uncertainty_.effective_unknowns; }
  const TableEvidence& tables_evidence() const { return uncertainty_.tables; }
  double charge_for_unknowns(double coordinates) const {
    return uncertainty_.charge_for_unknowns(coordinates);
  }
  const Identifiability& identifiability() const { return identifiability_; }

  /// Where a fit of this model with an effect added or removed can start (FitOptions::start).
  StartPoint start_point() const;
  /// Steps of all solutions within this fit: a start point reduces them.
  int solver_iterations() const { return solver_iterations_; }

  /// Measures the held-out errors that a fit without FitOptions::cross_validate left out.
  void cross_validate();

  /// The part of fit.json that follows from the numbers (docs/model.md).
  nlohmann::json document() const;
  /// Of document(), only errors and the noise floor.
  nlohmann::json errors_document() const;

 private:
  Fit() = default;
  static std::unique_ptr<Fit> run_once(const Robot& robot, const State::Columns& columns,
                                       const ModelSpecification& specification,
                                       const FitOptions& options, Observer& observer);
  void begin();
  bool is_newly_followed(const NonlinearParameter& parameter) const;
  void scale_noise(double factor);
  void rescale_noise();
  void solve_with_wider_priors();
  void weigh_orientations();
  bool has_the_nodes_of_the_start() const;
  bool smoothness_stands() const;
  bool change_smoothness();
  void begin_at(const StartPoint& start);
  // Largest relative change of springs and carried loads.
  double change_since(const StartPoint& start) const;
  double stand_as_fitted();
  void solve_from_here(Accuracy accuracy = Accuracy::kOnTheWay);
  void solve_from_anywhere();
  void choose_free();
  void solve_robustly();
  void choose_where_loads_act();
  bool keeps_weights() const;
  void count_from(const StartPoint& start);
  void solve_as_weighed();
  bool find_gross_errors();
  void fold_base_and_tool();
  void measure_errors();
  void predict_held_out(const EvaluatedRows& evaluated);

  std::shared_ptr<const Prepared> prepared_;
  std::shared_ptr<State> state_;
  Measurements measurements_;
  ModelSpecification specification_;
  FitOptions options_;
  Model model_;
  std::unique_ptr<Kinematics> kinematics_;
  std::unique_ptr<EffectContext> context_;
  std::unique_ptr<Design> design_;
  Identifiability identifiability_;
  std::vector<RejectedRow> rejected_;
  std::vector<std::string> warnings_;
  SolveSummary summary_;
  int solver_iterations_ = 0;
  Smoothness smoothness_;
  bool kept_weights_ = false;
  double effective_guess_ = 0.0;           // last known number of effective unknowns
  bool knows_effective_unknowns_ = false;  // effective_guess_ was counted for this smoothness
  double noise_scale_ = 1.0;
  double orientation_inflation_ = 1.0;
  NoiseFloor noise_floor_;
  Uncertainty uncertainty_;
  ErrorSummary nominal_, train_, train_with_history_;
  CrossValidation held_out_, held_out_with_history_;
};

}  // namespace armtrue
