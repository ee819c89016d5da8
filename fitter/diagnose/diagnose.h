// Which physical effect is missing, on which joint, how sure that is, and what else it could be.
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "fitter/diagnose/spectrum.h"
#include "fitter/diagnose/structure.h"
#include "fitter/diagnose/table_verdict.h"
#include "fitter/evidence/evidence.h"
#include "fitter/evidence/refit.h"

namespace armtrue {

/// Something is said to be missing, and something to be superfluous, where that is more probable
/// than this.
inline constexpr double kMoreLikelyThanNot = 0.5;
/// What a search is this sure of needs no other search: it comes in, and takes another's place.
inline constexpr double kSurely = 0.9;
/// Difference in BIC by which an effect shows alone: very strong evidence (Kass and Raftery 1995,
/// JASA 90, 773).
inline constexpr double kShowsAlone = -10.0;

enum class Verdict { kNothingMissing, kMissingEffect, kUnexplainedStructure };

/// An effect that the fit lacks.
struct Candidate {
  EffectRequest request;                 ///< as it would be added
  Block block;                           ///< its columns, nonlinear parameters where they do best
  std::map<std::string, double> starts;  ///< where its nonlinear parameters do best
  std::size_t evidence_block = 0;        ///< which of the evidence's
  double probability = 0.0;  ///< that it is present in the arm beside what the model has
  double in_any_form = 0.0;  ///< that its effect is, in this form or with other options
  double gain_beside = 0.0;  ///< fall of Σ r² beside the likeliest set
  bool likeliest = false;    ///< stands in that set
  bool spanned = false;      ///< fitted columns reproduce all of its own: it is not missing beside
                             ///< them, but may replace one of them
  bool left_out = false;     ///< was fitted and predicts unseen poses no better
  BlockScore score;          ///< of it alone beside the fit
  double log10_p = 0.0;      ///< F test of it alone, corrected for the number of candidates
  bool recommend = false;
  double held_out_mean = 0.0;         ///< expected mean held-out error once it is in the model [m]
  double delta_bic = 0.0;             ///< −2 log Bayes factor of it alone
  std::vector<Parameter> parameters;  ///< with values
  std::vector<double> sigma;
  std::vector<std::string> confounded_with;
  std::string why;
};

/// The parameters as documents list them: name, value, sigma, unit.
nlohmann::json parameters_json(const Candidate& candidate);

/// An effect of the fit that the search left out more often than not.
struct Superfluous {
  EffectRequest request;
  double probability = 0.0;  ///< of its presence
};

struct Diagnosis {
  Verdict verdict = Verdict::kNothingMissing;
  std::vector<Candidate> candidates;
  double probability_nothing = 1.0;  ///< that nothing is missing, in the catalogue or outside it
  std::vector<Superfluous> superfluous;               ///< least probable first
  std::map<std::string, double> probability_present;  ///< of the fit's own effects, by label
  NoiseParts noise;
  DecimalStep rounding;            ///< of the joints' angles, where it explains how they scatter
  double reading_sigma = 0.0;      ///< [m] a coordinate
  double orientation_sigma = 0.0;  ///< [rad] of measured orientations; 0: none
  std::vector<Untestable> untestable;
  std::vector<StructureFinding> structure;  ///< what the residual depends on, improbable ones aside
  std::vector<std::string> advice;
  std::vector<JointSpectrum> spectra;
  LackOfFit lack_of_fit;
  JointScatter scatter;
  std::optional<GrossCluster> gross;  ///< where it is no chance
  std::vector<TableVerdict> tables;   ///< of the fit: no physics
  double neighbour_ratio = 1.0;

  const Candidate* recommended() const;
  const Candidate* left_out() const;  ///< the most probable one; null: none
  /// The structure that no candidate explains: empty unless that is the verdict.
  std::span<const StructureFinding> unexplained() const;
  nlohmann::json to_json(const Fit& fit) const;
};

struct DiagnoseOptions {
  std::size_t listed = 20;  ///< candidates listed
  /// Labels of effects of the fit that a search put in; the owner of the arm believes in the
  /// others.
  std::set<std::string> searched;
  /// What was fitted beside this model and predicts unseen poses no better (key_of): it is not
  /// recommended, and its probability remains as doubt.
  std::set<std::string> left_out;
};

/// Updates recommendation, verdict and advice of `d`, which was made of `fit`, where more was
/// fitted beside it and left out since. False where only a new diagnosis can tell the verdict.
bool conclude_beside(Diagnosis& d, Fit& fit, const std::set<std::string>& left_out);

/// What tells a request from all others of a search: its label and its options.
std::string key_of(const EffectRequest& request);

Diagnosis diagnose(Fit& fit, const DiagnoseOptions& options, Observer& observer = Observer::none());

}  // namespace armtrue
