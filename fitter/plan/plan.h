// Optimal design of measurements: poses for a first campaign, poses that sharpen a fit, and poses
// that tell rival explanations apart.
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fitter/plan/fisher.h"
#include "fitter/plan/menu.h"
#include "fitter/solve/fit.h"

namespace armtrue {

struct PlanOptions {
  std::size_t poses = 50;
  std::size_t candidates = 4000;  ///< possible measurements to choose from
  std::uint64_t seed = 0;
  Cell cell;
  Levels levels;                  ///< of columns besides the joints; columns not given: as recorded
  std::size_t random_draws = 25;  ///< random choices of as many poses, for comparison

  /// For a first campaign, which has no data to determine these:
  std::optional<Instrument> instrument;
  double assumed_sigma = 10e-6;   ///< [m]
  double sigma_rotation = 20e-6;  ///< [rad]
  bool orientation = false;       ///< orientations are measured too
  std::optional<Eigen::Vector3d>
      tool;  ///< reflector in the flange [m], if robot.yaml does not state it

  /// From JSON with the keys of the members (assumed_sigma_m, sigma_rotation_rad). Throws
  /// ModelError.
  static PlanOptions from_json(const nlohmann::json& content);
};

/// Columns of the chosen measurements in the order to run them.
struct PlannedRows {
  std::vector<std::string> written;
  State::Columns columns;
};

/// Poses chosen to determine a model's parameters (D-optimality).
struct CampaignPlan {
  PlannedRows rows;
  Eigen::Index unknowns = 0;
  std::vector<std::string> weak;          ///< sentences: what these poses hardly determine
  std::size_t same_numbers = 0;           ///< parameters that no pose can separate from another
  std::optional<FisherSpectrum> present;  ///< with the measurements already taken
  FisherSpectrum planned,
      random;  ///< with the planned poses; with as many random ones (median draw)

  nlohmann::json to_json() const;
};

/// Poses for a first campaign with the model that will be fitted.
/// Throws ModelError if the tool is unknown, a column that the model reads has no levels, or hardly
/// any pose is admissible.
CampaignPlan plan_campaign(const Robot& robot, const ModelSpecification& specification,
                           const PlanOptions& options, Observer& observer = Observer::none());

/// Further poses for a fit's own parameters, given the information of its measurements.
CampaignPlan plan_sharpening(Fit& fit, const PlanOptions& options,
                             Observer& observer = Observer::none());

/// One rival explanation against another.
struct Separation {
  std::size_t truth = 0, rival = 0;  ///< into the list of candidates
  double present = 0.0;              ///< BIC of truth less BIC of rival, as measured
  /// Its expected values if `truth` is the cause and as large as fitted: with the planned poses,
  /// and the median with as many random ones.
  double planned = 0.0, random = 0.0;
};

struct SeparationPlan {
  PlannedRows rows;
  std::vector<std::string> candidates;
  std::vector<Separation> separations;  ///< every ordered pair

  nlohmann::json to_json() const;
};

/// Change of BIC when an effect is added to a fit.
struct Evidence {
  double delta_bic = 0.0;
  double misfit = 0.0;  ///< the part of it without the penalty for the number of parameters
};

/// The evidence for each effect, by refit; nullopt if it cannot be fitted.
std::vector<std::optional<Evidence>> evidence_of(Fit& fit,
                                                 const std::vector<EffectRequest>& effects);

/// Poses (and payloads, directions, temperatures) that tell `rivals` apart, each an effect that the
/// fit lacks: T-optimality on the fitted rivals' predictions, with every parameter of the wrong
/// rival free to adapt. Throws ModelError for fewer than two rivals or if one cannot be fitted.
SeparationPlan plan_separation(Fit& fit, const std::vector<EffectRequest>& rivals,
                               const PlanOptions& options, Observer& observer = Observer::none());

}  // namespace armtrue
