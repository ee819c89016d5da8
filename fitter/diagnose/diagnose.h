// Which physical effect is missing, on which joint, how sure that is, and what else it could be.
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fitter/diagnose/spectrum.h"
#include "fitter/diagnose/structure.h"

namespace armtrue {

enum class Verdict { kNothingMissing, kMissingEffect, kUnexplainedStructure };

struct Candidate {
  EffectRequest request;  ///< as it would be added
  Block block;            ///< the columns that were scored
  BlockScore score;
  std::map<std::string, double> starts;  ///< where its nonlinear parameters did best
  int searched = 0;                      ///< unknowns that were searched over (a period, a phase)
  double log10_p = 0.0;                  ///< corrected for the number of candidates
  bool recommend = false;
  bool confirmed = false;      ///< refitted: the figures below are measured, not predicted
  double held_out_mean = 0.0;  ///< mean held-out error if added [m]
  double delta_bic = 0.0;
  std::vector<Parameter> parameters;  ///< with values
  std::vector<double> sigma;
  double strangeness = 0.0;  ///< of what was confirmed, as strangeness() says it
  std::vector<std::string> confounded_with;
  std::string why;
};

struct Diagnosis {
  Verdict verdict = Verdict::kNothingMissing;
  std::vector<Candidate> candidates;
  std::vector<Untestable> untestable;
  std::vector<StructureFinding> unexplained;
  std::vector<std::string> advice;
  std::vector<JointSpectrum> spectra;
  LackOfFit lack_of_fit;
  JointScatter scatter;
  double neighbour_ratio = 1.0;

  const Candidate* recommended() const;
  nlohmann::json to_json(const Fit& fit) const;
};

struct DiagnoseOptions {
  std::size_t listed = 20;    ///< candidates listed
  std::size_t confirmed = 6;  ///< candidates refitted
  bool look_ahead = true;     ///< guard against proxies of structure that no effect names
  bool generic = true;        ///< tables and periods read off the spectra among the candidates
};

/// Fall of BIC that an effect has to bring to stand beside a table on its joint: what the table
/// does not follow well for want of nodes looks like an effect.
constexpr double kBesideTable = 25.0;

/// True for an effect with a shape of its own on a joint on which the fit also has a table.
bool is_beside_table(const Fit& fit, const EffectRequest& request);

/// True where one refit takes seconds, by the number of rows or of unknowns: no look ahead then,
/// and fewer trials.
bool is_large(const Fit& fit);

Diagnosis diagnose(Fit& fit, const DiagnoseOptions& options, Observer& observer = Observer::none());

/// Bayesian information criterion of a fit, up to a constant of the data set: comparable between
/// fits of the same rows.
double bayesian_information(Fit& fit);

/// −2 log of a prior on what is usual of an effect in a fit: on its sizes, where the effect says
/// which, and on its running against the load that it carries. No more than a gentle word: what the
/// data say clearly, they say louder.
double strangeness(Fit& fit, const EffectRequest& request);

/// "gear_harmonics 3": a request as people say it.
std::string label(const EffectRequest& request);

/// The same model with one more effect. `options` of the request that stand for nonlinear
/// parameters are left to be found.
ModelSpecification with_effect(const ModelSpecification& specification,
                               const EffectRequest& request);

/// Whether a refit measures held-out errors at once or leaves that to Fit::cross_validate: where
/// many trials are made, most are asked for their evidence alone.
enum class HeldOut { kAtOnce, kLater };

/// Fits again with another specification, same measurements and options. Nonlinear parameters start
/// where `fit` has them, or at `starts`; others are searched for.
std::unique_ptr<Fit> refit(const Fit& fit, const ModelSpecification& specification,
                           const std::map<std::string, double>& starts = {},
                           HeldOut held_out = HeldOut::kAtOnce);
/// The same, with the smoothness of tables chosen again: it may have been chosen while something
/// else was missing.
std::unique_ptr<Fit> refit_with_smoothness_anew(const Fit& fit,
                                                const ModelSpecification& specification,
                                                const std::map<std::string, double>& starts = {});
/// The same, with every nonlinear parameter searched for from nothing.
std::unique_ptr<Fit> search(const Fit& fit, const ModelSpecification& specification,
                            HeldOut held_out = HeldOut::kAtOnce);

}  // namespace armtrue
