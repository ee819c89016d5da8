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
  Levels levels;                  ///< of columns besides the joints; those not named: as recorded
  std::size_t random_draws = 25;  ///< of as many random poses, to compare with

  /// A first campaign has no data to tell these:
  std::optional<Instrument> instrument;
  double assumed_sigma = 10e-6;   ///< [m]
  double sigma_rotation = 20e-6;  ///< [rad]
  bool orientation = false;       ///< orientations are measured too
  std::optional<Eigen::Vector3d>
      tool;  ///< reflector in the flange [m], where robot.yaml does not say

  /// From JSON with the keys of the members (assumed_sigma_m, sigma_rotation_rad). Throws
  /// ModelError.
  static PlanOptions from_json(const nlohmann::json& content);
};

/// Columns of the chosen measurements in the order to run them.
struct PlannedRows {
  std::vector<std::string> written;
  State::Columns columns;
};

/// Poses chosen for what they tell of a model's parameters (D-optimality).
struct CampaignPlan {
  PlannedRows rows;
  Eigen::Index unknowns = 0;
  std::vector<std::string> weak;          ///< sentences: what these poses can hardly tell
  std::size_t same_numbers = 0;           ///< parameters that are another's whatever the pose
  std::optional<FisherSpectrum> present;  ///< what the measurements taken already know
  FisherSpectrum planned,
      random;  ///< with the planned poses; with as many random ones (median draw)

  nlohmann::json to_json() const;
};

/// Poses for a first campaign with the model that is going to be fitted.
/// Throws ModelError where the tool is unknown, a column that the model reads has no levels, or
/// hardly a pose is admissible.
CampaignPlan plan_campaign(const Robot& robot, const ModelSpecification& specification,
                           const PlanOptions& options, Observer& observer = Observer::none());

/// Further poses for a fit's own parameters, given what its measurements know already.
CampaignPlan plan_sharpening(Fit& fit, const PlanOptions& options,
                             Observer& observer = Observer::none());

/// One rival explanation against another.
struct Separation {
  std::size_t truth = 0, rival = 0;  ///< into the list of candidates
  double present = 0.0;              ///< BIC of truth less BIC of rival, as measured
  /// What it is expected to become if `truth` is the cause and as large as fitted, and the median
  /// for as many random poses.
  double planned = 0.0, random = 0.0;
};

struct SeparationPlan {
  PlannedRows rows;
  std::vector<std::string> candidates;
  std::vector<Separation> separations;  ///< every ordered pair

  nlohmann::json to_json() const;
};

/// What an effect brings when it is added to a fit.
struct Evidence {
  double delta_bic = 0.0;
  double misfit = 0.0;  ///< the part of it that is not for the number of parameters
};

/// The evidence for each effect, by refit; nothing where it cannot be fitted.
std::vector<std::optional<Evidence>> evidence_of(Fit& fit,
                                                 const std::vector<EffectRequest>& effects);

/// Poses (and payloads, directions, temperatures) that tell `rivals` apart, each being an effect
/// that the fit lacks: T-optimality on the fitted rivals' predictions, every parameter of the wrong
/// one free to follow. Throws ModelError for fewer than two rivals or where one cannot be fitted.
SeparationPlan plan_separation(Fit& fit, const std::vector<EffectRequest>& rivals,
                               const PlanOptions& options, Observer& observer = Observer::none());

}  // namespace armtrue
