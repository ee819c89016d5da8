// Diagnosis: which effect is missing, on which joint, how probable it is, what else it could be.
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

/// An effect is reported as missing, or as superfluous, if that is more probable than this.
inline constexpr double kMoreLikelyThanNot = 0.5;
/// An effect of this probability is added without another search and may replace another effect.
inline constexpr double kSurely = 0.9;
/// ΔBIC below which an effect is significant when added alone: very strong evidence (Kass and
/// Raftery 1995, JASA 90, 773).
inline constexpr double kShowsAlone = -10.0;

enum class Verdict { kNothingMissing, kMissingEffect, kUnexplainedStructure };

/// An effect that the fit lacks.
struct Candidate {
  EffectRequest request;                 ///< as it would be added
  Block block;                           ///< its columns, at the best nonlinear parameters
  std::map<std::string, double> starts;  ///< best values of its nonlinear parameters
  std::size_t evidence_block = 0;        ///< index in EvidenceSummary::blocks
  double probability = 0.0;              ///< that the arm has it in addition to the model's effects
  double in_any_form = 0.0;              ///< the same, in this form or with other options
  double gain_beside = 0.0;              ///< fall of Σ r² by it, beside the likeliest set
  bool likeliest = false;                ///< in the likeliest set
  bool spanned = false;   ///< fitted columns reproduce its own: it is not missing beside them, but
                          ///< may replace one of them
  bool left_out = false;  ///< was fitted and predicts held-out poses no better
  bool instead = false;   ///< probable only in place of an effect of the fit: it is not missing
  BlockScore score;       ///< when added to the fit alone
  double log10_p = 0.0;   ///< F test of it alone, corrected for the number of candidates
  bool recommend = false;
  double held_out_mean = 0.0;         ///< expected mean held-out error with it in the model [m]
  double delta_bic = 0.0;             ///< −2 log Bayes factor of it alone
  std::vector<Parameter> parameters;  ///< with values
  std::vector<double> sigma;
  std::vector<std::string> confounded_with;
  std::string why;
};

/// The parameters as documents list them: name, value, sigma, unit.
nlohmann::json parameters_json(const Candidate& candidate);

/// An effect of the fit that is probably absent.
struct Superfluous {
  EffectRequest request;
  double probability = 0.0;  ///< that it is present
};

struct Diagnosis {
  Verdict verdict = Verdict::kNothingMissing;
  std::vector<Candidate> candidates;
  /// That the search finds nothing missing: a candidate in place of an effect of the fit counts as
  /// none.
  double nothing_searched = 1.0;
  /// That nothing is missing, in the catalogue or outside it. At least kMoreLikelyThanNot if and
  /// only if the verdict is kNothingMissing.
  double probability_nothing = 1.0;
  std::vector<Superfluous> superfluous;               ///< least probable first
  std::map<std::string, double> probability_present;  ///< of the fit's own effects, by label
  NoiseParts noise;
  DecimalStep rounding;            ///< of the joint angles, if it explains the joints' scatter
  double reading_sigma = 0.0;      ///< of a reading [m], each coordinate
  double orientation_sigma = 0.0;  ///< [rad] of measured orientations; 0: none
  std::vector<Untestable> untestable;
  std::vector<StructureFinding> structure;  ///< what the residual depends on, if not improbable
  std::vector<std::string> advice;
  std::vector<JointSpectrum> spectra;
  LackOfFit lack_of_fit;
  JointScatter scatter;
  std::optional<GrossCluster> gross;  ///< only if significant
  std::vector<TableVerdict> tables;   ///< one for each table of the fit
  double neighbour_ratio = 1.0;

  const Candidate* recommended() const;
  const Candidate* left_out() const;  ///< the most probable one that was left out; null: none
  /// Whether the residual has structure or exceeds noise, whatever candidates say.
  bool has_structure() const;
  /// Structure that no candidate explains; empty unless the verdict is kUnexplainedStructure.
  std::span<const StructureFinding> unexplained() const;
  nlohmann::json to_json(const Fit& fit) const;
};

struct DiagnoseOptions {
  std::size_t listed = 20;  ///< most candidates listed
  /// Labels of the fit's effects that a search added; the owner of the arm specified the others.
  std::set<std::string> searched;
  /// Keys (key_of) of candidates that were fitted beside this model and predict held-out poses no
  /// better. They are not recommended, and their probability still counts as doubt.
  std::set<std::string> left_out;
};

/// Derives probability_nothing, verdict and advice from the candidates and their recommendation.
void conclude(Diagnosis& d, const Fit& fit, const Linearization& linearization);

/// Updates recommendation, verdict and advice of `d`, the diagnosis of `fit`, after candidates were
/// fitted beside it and left out. Returns false if no other candidate is recommended: the verdict
/// then needs a new diagnosis.
bool conclude_beside(Diagnosis& d, Fit& fit, const std::set<std::string>& left_out);

/// Key that distinguishes a request from all others of a search: its label and its options.
std::string key_of(const EffectRequest& request);

Diagnosis diagnose(Fit& fit, const DiagnoseOptions& options, Observer& observer = Observer::none());

}  // namespace armtrue
