#include "fitter/diagnose/diagnose.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <thread>
#include <tuple>

#include "fitter/diagnose/advice.h"
#include "fitter/diagnose/words.h"
#include "fitter/solve/parallel.h"

namespace armtrue {
namespace {

using nlohmann::json;

// One false alarm in ten thousand campaigns, after correction for the number of candidates.
constexpr double kSignificant = -4.0;
constexpr double kStructureSignificant = -5.0;
constexpr double kDecisive = 10.0;  // ΔBIC, "very strong" (Kass and Raftery 1995)
// What can bend to follow anything (a table) is asked for more.
constexpr double kDecisiveGeneric = 40.0;
constexpr double kEqualEvidence = 4.0;
constexpr double kStrangest = 20.0;
// What runs against a load by this cosine or more carries it, whatever else its shape does.
constexpr double kCarries = 0.5;
// Candidates of which a table leaves less than this to be seen are refitted beside it.
constexpr double kHiddenShare = 0.3;
// The share of the evidence asked for that linear algebra must promise before a refit is made.
constexpr double kWorthRefit = 0.5;
constexpr double kSameExplanation =
    0.9;  // share of the best candidate's that makes another one confounded with it
// A rival that explains this much of its own beside a candidate is another effect, no alternative.
constexpr double kIndependentShare = 0.5;
constexpr std::size_t kSpectralPeaks = 3;
constexpr double kLowestLine = 2.5;  // below this, harmonics and geometry tell the tale
constexpr int kLookAhead = 8;
constexpr std::size_t kManyUnknowns = 12;     // of a candidate: a table's, whose refit takes long
constexpr std::size_t kLargeCampaign = 2000;  // rows
constexpr std::size_t kLargeModel = 400;      // parameters: tables on several joints

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f %%", 100.0 * share);
  return text;
}

// Lines of the spectra as gear_mesh candidates, where the catalogue's own orders do not cover them
// already.
void add_spectral_blocks(const Fit& fit, const Scorer& scorer,
                         const std::vector<JointSpectrum>& spectra, std::vector<Block>& blocks,
                         double& lines) {
  for (const JointSpectrum& spectrum : spectra) {
    lines += static_cast<double>(spectrum.cycles.size()) / 4.0;
    const double ratio =
        fit.robot().joints[static_cast<std::size_t>(spectrum.joint - 1)].gear_ratio;
    for (const SpectralPeak& peak : highest_peaks(spectrum, scorer, fit.state(), kSpectralPeaks)) {
      if (peak.cycles < kLowestLine) continue;
      const double width = 0.5 * spectrum.resolution;
      const auto known = [&](double order) {
        return ratio > 0.0 && std::abs(peak.cycles - order * ratio) < width;
      };
      if (known(0.5) || known(1.0) || known(2.0) || known(4.0)) continue;
      const double whole = std::round(peak.cycles);
      const double cycles =
          std::abs(peak.cycles - whole) < 0.3 * spectrum.resolution ? whole : peak.cycles;
      Block block =
          make_block(fit.context(), {"gear_mesh", {spectrum.joint}, {{"cycles", {cycles}}}});
      const bool held =
          std::any_of(block.terms.parameters.begin(), block.terms.parameters.end(),
                      [&](const Parameter& p) { return fit.model().index(p.name) >= 0; });
      block.searched = 1;
      if (!held) blocks.push_back(std::move(block));
    }
  }
}

Candidate make_candidate(const Block& block, const BlockScore& score, double correction,
                         const Fit& fit) {
  Candidate c;
  c.request = as_added(block.request);
  c.block = block;
  c.searched = block.searched;
  for (const std::string& option : find_effect(block.request.effect).searched_options()) {
    if (block.request.options.contains(option))
      c.starts[block.request.effect + "_" + option] = block.request.options[option];
  }
  c.score = score;
  c.log10_p = std::min(0.0, score.log10_p + correction);
  c.delta_bic = score.delta_bic;
  c.held_out_mean = fit.held_out_error().mean * std::sqrt(std::max(0.0, 1.0 - score.explained));
  c.parameters = block.terms.parameters;
  for (std::size_t i = 0; i < c.parameters.size(); ++i)
    c.parameters[i].value = score.coefficient[i];
  c.sigma = score.sigma;
  if (!score.objection.empty()) c.why = score.objection;
  return c;
}

// Of blocks that differ only in what was stepped through, the best stays.
std::vector<Candidate> best_of_each(const std::vector<Block>& blocks,
                                    const std::vector<BlockScore>& scores, double correction,
                                    const Fit& fit) {
  std::map<std::string, std::size_t> best;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const EffectRequest added = as_added(blocks[i].request);
    const std::string key = label(added) + added.options.dump();
    const auto [at, fresh] = best.try_emplace(key, i);
    if (!fresh && scores[i].delta_bic < scores[at->second].delta_bic) at->second = i;
  }
  std::vector<Candidate> result;
  for (const auto& [key, i] : best)
    result.push_back(make_candidate(blocks[i], scores[i], correction, fit));
  std::sort(result.begin(), result.end(), [](const Candidate& a, const Candidate& b) {
    return std::pair{a.score.degrees == 0, a.delta_bic} <
           std::pair{b.score.degrees == 0, b.delta_bic};
  });
  return result;
}

// Options of a refit in which nonlinear parameters begin at `starts`, or where `fit` has them.
FitOptions refit_options(const Fit& fit, const std::map<std::string, double>& starts) {
  FitOptions options = fit.options();
  options.nonlinear_starts = starts;
  options.nonlinear_guesses.clear();
  options.start = std::make_shared<StartPoint>(fit.start_point());
  if (fit.smooth()) options.smoothness_sigma = fit.smoothness_sigma();
  for (const NonlinearParameter& p : fit.model().nonlinear)
    options.nonlinear_starts.try_emplace(p.name, p.value);
  return options;
}

// Held-out errors of two fits, by folding, on the rows that either keeps. Where one fit alone
// keeps a row out (a local effect that it lacks looks like gross errors), its residual there is a
// prediction that it was not fitted to.
std::pair<std::vector<ErrorSummary>, std::vector<ErrorSummary>> held_out_errors_on_same_rows(
    const Fit& a, const Fit& b) {
  const auto residuals = [](const Fit& fit) {
    std::map<std::size_t, double> by_row;
    for (const RejectedRow& r : fit.rejected()) by_row[r.row] = r.residual;
    return by_row;
  };
  const auto of_a = residuals(a), of_b = residuals(b);
  std::pair<std::vector<ErrorSummary>, std::vector<ErrorSummary>> result;
  for (std::size_t folding = 0; folding < a.held_out_distances_by_row().size(); ++folding) {
    std::vector<double> in_a = a.held_out_distances_by_row()[folding];
    std::vector<double> in_b = b.held_out_distances_by_row()[folding];
    for (const auto& [row, residual] : of_a) {
      if (!of_b.contains(row)) in_a[row] = residual;
    }
    for (const auto& [row, residual] : of_b) {
      if (!of_a.contains(row)) in_b[row] = residual;
    }
    result.first.push_back(summarise_finite(in_a));
    result.second.push_back(summarise_finite(in_b));
  }
  return result;
}

// What an effect that carries a load does to it.
struct Carrying {
  double largest = 0.0;  // of what the effect gives [its coordinate's unit]
  double cosine = -1.0;  // between what it gives and the load, over the rows: −1 where it carries
};

Carrying carrying_of(Fit& fit, const std::string& effect, const CarriedLoad& load) {
  const std::vector<Parameter>& parameters = fit.model().parameters;
  // A recorded torque may have any sign.
  const bool signed_load = fit.state().computes_torque();
  Carrying result;
  double product = 0.0, given_squares = 0.0, load_squares = 0.0;
  std::vector<BasisTable::Entry> entries;
  for (std::size_t i = 0; i < fit.design().rows(); ++i) {
    fit.design().basis().row(i, entries);
    double given = 0.0;
    for (const BasisTable::Entry& entry : entries) {
      const Parameter& p = parameters[static_cast<std::size_t>(entry.parameter)];
      if (p.effect == effect) given += p.value * entry.value;
    }
    result.largest = std::max(result.largest, std::abs(given));
    if (!signed_load) continue;
    const double torque = fit.state().column(load.torque)[i];
    product += given * torque;
    given_squares += given * given;
    load_squares += torque * torque;
  }
  if (given_squares > 0.0 && load_squares > 0.0)
    result.cosine = product / std::sqrt(given_squares * load_squares);
  return result;
}

// How a confirmation has the smoothness of the fit's tables.
enum class Smoothness { kKept, kAnew };

// Refits with the candidate in: coefficients, evidence and held-out error are then measured. False
// where the refit refuses it.
bool confirm(const Fit& fit, double bic, Candidate& candidate, std::unique_ptr<Fit>& refitted,
             Smoothness smoothness = Smoothness::kKept) {
  // Where the linear score was best on the grid need not be near the best minimum.
  FitOptions options = refit_options(fit, {});
  if (smoothness == Smoothness::kAnew) options.smoothness_sigma = fit.options().smoothness_sigma;
  options.nonlinear_guesses = candidate.starts;
  refitted = Fit::run(fit.robot(), fit.state().columns(),
                      with_effect(fit.specification(), candidate.request), options);
  for (const NonlinearParameter& p : refitted->model().nonlinear)
    candidate.starts[p.name] = p.value;
  candidate.delta_bic = bayesian_information(*refitted) - bic;
  candidate.held_out_mean = refitted->held_out_error().mean;
  candidate.confirmed = true;
  const std::set<std::string> before = [&] {
    std::set<std::string> names;
    for (const Parameter& p : fit.model().parameters) names.insert(p.name);
    return names;
  }();
  candidate.parameters.clear();
  candidate.sigma.clear();
  for (std::size_t i = 0; i < refitted->model().parameters.size(); ++i) {
    const Parameter& p = refitted->model().parameters[i];
    if (before.contains(p.name)) continue;
    const int unknown = refitted->design().unknown_of(static_cast<int>(i));
    const double sigma =
        unknown < 0 ? 0.0 : std::sqrt(std::max(0.0, refitted->covariance()(unknown, unknown)));
    candidate.parameters.push_back(p);
    candidate.sigma.push_back(sigma);
    if (p.sign != 0 && p.sign * p.value < -3.0 * sigma) {
      candidate.why =
          describe(p) + " would have the wrong sign: a spring yields, it does not push back";
      return false;
    }
    if (p.bound > 0.0 && std::abs(p.value) - 3.0 * sigma > p.bound) {
      candidate.why = describe(p) + " would be larger than is physical";
      return false;
    }
  }
  const auto load = find_effect(candidate.request.effect).carries();
  if (load && carrying_of(*refitted, candidate.request.effect, *load).largest > load->largest) {
    candidate.why = "what it gives would be larger than is physical";
    return false;
  }
  candidate.strangeness = strangeness(*refitted, candidate.request);
  const auto [before_error, after_error] = held_out_errors_on_same_rows(fit, *refitted);
  if (after_error[0].mean >= before_error[0].mean ||
      after_error[0].rms >= 1.01 * before_error[0].rms) {
    candidate.why = "cross-validation does not confirm it: held-out poses are not predicted better";
    return false;
  }
  if (after_error[1].mean > 1.02 * before_error[1].mean &&
      after_error[2].mean > 1.02 * before_error[2].mean) {
    candidate.why =
        "blocked cross-validation does not confirm it: other times and other regions are predicted "
        "worse";
    return false;
  }
  return true;
}

// Fall of BIC that is asked of a candidate.
double decisive(const Fit& fit, const EffectRequest& request) {
  if (find_effect(request.effect).generic()) return kDecisiveGeneric;
  return is_beside_table(fit, request) ? kBesideTable : kDecisive;
}

// The first candidates that are worth a refit.
std::vector<std::size_t> promising_of(const std::vector<Candidate>& candidates, std::size_t most) {
  std::vector<std::size_t> promising;
  for (std::size_t i = 0; i < candidates.size() && promising.size() < most; ++i) {
    const Candidate& c = candidates[i];
    if (c.log10_p <= kSignificant && c.score.delta_bic <= -kDecisive && c.score.degrees > 0)
      promising.push_back(i);
  }
  return promising;
}

// Those of `promising` that a refit confirms. `beside` is done meanwhile.
template <typename Report>
std::vector<std::size_t> confirmed_of(Fit& fit, double bic, std::vector<Candidate>& candidates,
                                      const std::vector<std::size_t>& promising,
                                      const Report& report,
                                      const std::function<void()>& beside = nullptr) {
  std::vector<char> holds(promising.size(), 0);
  std::atomic<int> done = 0;
  const auto caller = std::this_thread::get_id();
  // What takes longest begins first, lest one processor waits for it in the end.
  std::vector<std::size_t> order(promising.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const auto effort = [&](std::size_t k) {
      const Candidate& c = candidates[promising[k]];
      return std::pair{c.parameters.size() > kManyUnknowns, c.searched};
    };
    return effort(a) > effort(b);
  });
  in_parallel(promising.size() + 1, [&](std::size_t job) {
    if (job == 0) {
      if (beside) beside();
      return;
    }
    const std::size_t k = order[job - 1];
    // An objection of the linear score is not the last word: the refit's own coefficients are.
    Candidate& c = candidates[promising[k]];
    c.why.clear();
    std::unique_ptr<Fit> refitted;
    try {
      const bool confirmed = confirm(fit, bic, c, refitted);
      holds[k] = confirmed && c.delta_bic + c.strangeness < -decisive(fit, c.request);
      if (c.why.empty()) c.score.objection.clear();
      if (confirmed && !holds[k]) c.why = "the refit's evidence is too little for it";
    } catch (const ModelError& error) {
      c.why = error.what();
    }
    const double share = static_cast<double>(++done) / static_cast<double>(promising.size());
    if (std::this_thread::get_id() == caller) report(0.4 + 0.3 * share, "confirming by refit");
  });
  std::vector<std::size_t> confirmed;
  for (std::size_t k = 0; k < promising.size(); ++k) {
    if (holds[k]) confirmed.push_back(promising[k]);
  }
  return confirmed;
}

// Candidates that the fit's tables hide and that, as far as linear algebra can say, would bring
// enough with the smoothness of the tables chosen anew.
std::vector<std::size_t> worth_a_refit_beside_tables(Fit& fit, const Scorer& scorer,
                                                     const std::vector<Candidate>& candidates) {
  std::vector<std::size_t> hidden;
  std::vector<Block> blocks;
  std::vector<Eigen::Index> widths;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& c = candidates[i];
    if (!is_beside_table(fit, c.request) || c.score.separability >= kHiddenShare) continue;
    hidden.push_back(i);
    blocks.push_back(c.block);
    widths.push_back(static_cast<Eigen::Index>(c.block.terms.parameters.size()));
  }
  if (hidden.empty()) return hidden;
  const EvaluatedRows evaluated = evaluate_rows(fit.design());
  std::vector<Eigen::Index> kept;
  for (const std::size_t row : evaluated.index) {
    for (int h = 0; h < scorer.height(); ++h)
      kept.push_back(static_cast<Eigen::Index>(row) * scorer.height() + h);
  }
  const Eigen::MatrixXd columns = scorer.columns(blocks)(kept, Eigen::all);
  const std::vector<double> changes =
      bic_changes_beside_tables(fit.design(), evaluated, columns, widths, smoothnesses());
  std::vector<std::size_t> worth;
  for (std::size_t k = 0; k < hidden.size(); ++k) {
    if (changes[k] <= -kWorthRefit * kBesideTable) worth.push_back(hidden[k]);
  }
  return worth;
}

// What a table on its joint can follow is hidden from the score at the table's own smoothness; with
// the effect in, the table may become smoother. Such candidates are refitted with smoothness anew.
// Returns those that hold.
std::vector<std::size_t> hidden_by_tables(Fit& fit, const Scorer& scorer, double bic,
                                          std::vector<Candidate>& candidates) {
  const std::vector<std::size_t> hidden = worth_a_refit_beside_tables(fit, scorer, candidates);
  std::vector<char> holds(hidden.size(), 0);
  in_parallel(hidden.size(), [&](std::size_t k) {
    Candidate trial = candidates[hidden[k]];
    std::unique_ptr<Fit> refitted;
    try {
      if (!confirm(fit, bic, trial, refitted, Smoothness::kAnew) ||
          trial.delta_bic + trial.strangeness > -kBesideTable)
        return;
    } catch (const ModelError&) {
      return;
    }
    const double n = static_cast<double>(fit.design().rows()) * fit.design().residuals_per_row();
    const int degrees = static_cast<int>(trial.parameters.size()) + trial.searched;
    trial.score.objection.clear();
    trial.score.degrees = degrees;
    trial.score.gain = degrees * std::log(n) - trial.delta_bic;
    trial.score.explained =
        std::max(0.0, 1.0 - std::pow(refitted->train_error().rms / fit.train_error().rms, 2));
    const double freedom = std::max(1.0, n - refitted->effective_unknowns());
    trial.log10_p = log10_f_survival(trial.score.gain / degrees, degrees, freedom) +
                    std::log10(static_cast<double>(hidden.size()));
    candidates[hidden[k]] = trial;
    holds[k] = trial.log10_p <= kSignificant;
  });
  std::vector<std::size_t> held;
  for (std::size_t k = 0; k < hidden.size(); ++k) {
    if (holds[k]) held.push_back(hidden[k]);
  }
  return held;
}

std::string evidence(const Candidate& c, const Fit& fit) {
  char text[256];
  std::snprintf(text, sizeof text,
                "explains %s of the squared residual, log10 p %.0f, BIC falls by %.0f, held-out "
                "mean %s -> %s",
                percent(c.score.explained).c_str(), c.log10_p, -c.delta_bic,
                micrometre_words(fit.held_out_error().mean).c_str(),
                micrometre_words(c.held_out_mean).c_str());
  return text;
}

// A table on one joint won: every joint on which a table beats every physical effect gets one at
// once.
void widen_tables(Fit& fit, double bic, const std::vector<Candidate>& all, Candidate& best) {
  std::map<int, double> physical;
  for (const Candidate& c : all) {
    if (find_effect(c.request.effect).generic()) continue;
    for (const int joint : c.request.joints) {
      const auto [at, fresh] = physical.try_emplace(joint, c.score.delta_bic);
      if (!fresh) at->second = std::min(at->second, c.score.delta_bic);
    }
  }
  Candidate wide = best;
  for (const Candidate& c : all) {
    if (c.request.effect != best.request.effect || c.log10_p > kSignificant) continue;
    const int joint = c.request.joints.front();
    if (joint == best.request.joints.front()) continue;
    const double rival = physical.contains(joint) ? physical[joint] : 0.0;
    if (c.score.delta_bic < rival - kDecisive) wide.request.joints.push_back(joint);
  }
  if (wide.request.joints.size() < 2) return;
  std::sort(wide.request.joints.begin(), wide.request.joints.end());
  std::unique_ptr<Fit> refitted;
  if (confirm(fit, bic, wide, refitted) && wide.delta_bic < best.delta_bic) {
    wide.score.explained = 1.0 - std::pow(refitted->train_error().rms / fit.train_error().rms, 2);
    wide.score.gain = best.score.gain * wide.score.explained / best.score.explained;
    best = wide;
  }
}

// The candidate with the most evidence and the least strange size. Of those that are equal for all
// that the data can say, the one with the fewest searched and then the fewest other unknowns: what
// can bend to fit anything should not win by a hair.
std::size_t choose(const std::vector<Candidate>& all, const std::vector<std::size_t>& accepted) {
  const auto cost = [&](std::size_t k) { return all[k].delta_bic + all[k].strangeness; };
  const auto rank = [&](std::size_t k) {
    return std::tuple{find_effect(all[k].request.effect).generic(), all[k].searched,
                      all[k].parameters.size()};
  };
  const std::size_t best =
      *std::min_element(accepted.begin(), accepted.end(),
                        [&](std::size_t a, std::size_t b) { return cost(a) < cost(b); });
  std::size_t choice = best;
  for (const std::size_t i : accepted) {
    if (cost(i) < cost(best) + kEqualEvidence && rank(i) < rank(choice)) choice = i;
  }
  return choice;
}

// The same effect on fewer or more of the joints is not a rival.
bool is_part_of(const EffectRequest& a, const EffectRequest& b) {
  return a.effect == b.effect && std::any_of(a.joints.begin(), a.joints.end(), [&](int k) {
           return std::find(b.joints.begin(), b.joints.end(), k) != b.joints.end();
         });
}

// Squares that `b` explains beyond what `a` does, as a share of what it explains alone.
double share_beyond(const Scorer& scorer, const Candidate& a, const Candidate& b) {
  Block both = a.block;
  both.terms.parameters.insert(both.terms.parameters.end(), b.block.terms.parameters.begin(),
                               b.block.terms.parameters.end());
  const double gain = scorer.score({both}).front().gain;
  return (gain - a.score.gain) / b.score.gain;
}

// Alternatives to a candidate: what explains nearly as much, and nothing more once the candidate
// has explained its part. Two effects that are both there are none.
void name_confounded(const Scorer& scorer, std::vector<Candidate>& candidates) {
  for (Candidate& c : candidates) {
    if (c.log10_p > kSignificant) continue;
    for (const Candidate& other : candidates) {
      if (&other == &c || is_part_of(other.request, c.request) || other.log10_p > kSignificant ||
          !other.score.objection.empty())
        continue;
      // By another thermometer it has the same name.
      const std::string name = label(other.request);
      const auto named = std::find(c.confounded_with.begin(), c.confounded_with.end(), name);
      if (name == label(c.request) || named != c.confounded_with.end()) continue;
      if (other.score.gain >= kSameExplanation * c.score.gain &&
          share_beyond(scorer, c, other) < kIndependentShare)
        c.confounded_with.push_back(name);
    }
  }
}

// Structure blocks as custom effects: a stand-in for whatever the catalogue does not name.
ModelSpecification with_structure(const ModelSpecification& specification,
                                  const StructureFinding& finding) {
  ModelSpecification result = specification;
  for (const Parameter& p : finding.block.terms.parameters) {
    EffectRequest request{"custom",
                          {},
                          {{"name", p.name},
                           {"coordinate", finding.coordinate},
                           {"expression", p.terms.front().basis.to_string()},
                           {"bound", 1.0}}};
    result.effects.push_back(request);
  }
  return result;
}

// Adds what is recommended until nothing is, and returns the fit that ends it.
std::unique_ptr<Fit> look_ahead(const Fit& fit, const Candidate& first,
                                const DiagnoseOptions& options) {
  std::unique_ptr<Fit> current =
      refit(fit, with_effect(fit.specification(), first.request), first.starts);
  DiagnoseOptions quick = options;
  quick.look_ahead = false;
  quick.confirmed = 3;
  for (int step = 0; step < kLookAhead; ++step) {
    const Diagnosis next = diagnose(*current, quick);
    const Candidate* recommended = next.recommended();
    if (!recommended) break;
    current = refit(*current, with_effect(current->specification(), recommended->request),
                    recommended->starts);
  }
  return current;
}

// True where the recommended effect only stands in for structure that no effect names.
bool is_proxy(Fit& fit, const Candidate& best, const Structure& structure,
              const DiagnoseOptions& options) {
  if (structure.findings.empty()) return false;
  const StructureFinding& rival = structure.findings.front();
  if (rival.score.delta_bic > best.delta_bic - kDecisive) return false;
  std::unique_ptr<Fit> end = look_ahead(fit, best, options);
  const Scorer at_end(*end);
  const Structure left = find_structure(at_end, *end, kStructureSignificant);
  if (left.findings.empty()) return false;
  // The structure outlives all that the catalogue offers. Does the effect outlive the structure?
  std::unique_ptr<Fit> with = refit(fit, with_structure(fit.specification(), rival));
  const Scorer beside(*with);
  const std::vector<Block> block{make_block(with->context(), best.request)};
  const BlockScore score = beside.score(block).front();
  return score.delta_bic > -kDecisive || score.log10_p > kSignificant - 2.0;
}

}  // namespace

std::string label(const EffectRequest& request) {
  std::string text = request.effect;
  for (std::size_t i = 0; i < request.joints.size(); ++i)
    text += (i ? "," : " ") + std::to_string(request.joints[i]);
  for (const auto& [key, value] : request.options.items()) {
    if (key != "orders" && key != "cycles") continue;
    text += " " + key + " " + list_words(value);
  }
  return text;
}

ModelSpecification with_effect(const ModelSpecification& specification,
                               const EffectRequest& request) {
  ModelSpecification result = specification;
  const EffectRequest added = as_added(request);
  for (EffectRequest& entry : result.effects) {
    const bool each = find_effect(entry.effect).joint_rule() == JointRule::kEach;
    if (!each || entry.effect != added.effect || entry.joints.empty() ||
        entry.options != added.options)
      continue;
    entry.joints.insert(entry.joints.end(), added.joints.begin(), added.joints.end());
    std::sort(entry.joints.begin(), entry.joints.end());
    return result;
  }
  result.effects.push_back(added);
  return result;
}

std::unique_ptr<Fit> refit(const Fit& fit, const ModelSpecification& specification,
                           const std::map<std::string, double>& starts, HeldOut held_out) {
  FitOptions options = refit_options(fit, starts);
  options.cross_validate = options.cross_validate && held_out == HeldOut::kAtOnce;
  return Fit::run(fit.robot(), fit.state().columns(), specification, options);
}

std::unique_ptr<Fit> search(const Fit& fit, const ModelSpecification& specification,
                            HeldOut held_out) {
  FitOptions options = fit.options();
  options.cross_validate = options.cross_validate && held_out == HeldOut::kAtOnce;
  options.nonlinear_starts.clear();
  options.nonlinear_guesses.clear();
  options.start = std::make_shared<StartPoint>(fit.start_point());
  return Fit::run(fit.robot(), fit.state().columns(), specification, options);
}

std::unique_ptr<Fit> refit_with_smoothness_anew(const Fit& fit,
                                                const ModelSpecification& specification,
                                                const std::map<std::string, double>& starts) {
  FitOptions options = refit_options(fit, starts);
  options.smoothness_sigma.reset();
  return Fit::run(fit.robot(), fit.state().columns(), specification, options);
}

double strangeness(Fit& fit, const EffectRequest& request) {
  double sum = 0.0;
  for (const Parameter& p : fit.model().parameters) {
    if (p.effect != request.effect || p.usual <= 0.0) continue;
    const bool asked = std::all_of(p.joints.begin(), p.joints.end(), [&](int k) {
      return request.joints.empty() ||
             std::find(request.joints.begin(), request.joints.end(), k) != request.joints.end();
    });
    if (asked) sum += std::pow(p.value / p.usual, 2);
  }
  if (const auto load = find_effect(request.effect).carries()) {
    const double cosine = carrying_of(fit, request.effect, *load).cosine;
    sum += kStrangest * std::clamp(1.0 + cosine / kCarries, 0.0, 1.0);
  }
  return std::min(sum, kStrangest);
}

double bayesian_information(Fit& fit) {
  Design& design = fit.design();
  Design::Row row;
  std::vector<std::size_t> rows;
  std::vector<double> position, rotation;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    if (design.weights()[i] == 0.0) continue;
    design.evaluate(i, false, row);
    position.insert(position.end(), row.residual.data(), row.residual.data() + 3);
    rotation.insert(rotation.end(), row.residual.data() + 3, row.residual.data() + 6);
    rows.push_back(i);
  }
  const Replicates replicates(fit.measurements(), rows);
  // A rejected row counts as the largest residual that would have been kept, so that rejecting is
  // never evidence.
  constexpr double kRejected = 64.0;
  const double total = static_cast<double>(design.rows());
  const double kept = std::max(1.0, static_cast<double>(rows.size()));
  const double rejected = (total - static_cast<double>(rows.size())) * kRejected / kept;
  const auto misfit = [&](const std::vector<double>& values, double penalty, double scale) {
    Eigen::VectorXd white =
        Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
    const double correlation = replicates.correlation(white, 3);
    replicates.whiten(white, 3, correlation);
    return 3.0 * total *
               std::log((white.squaredNorm() + penalty) * scale * scale * (1.0 + rejected)) +
           3.0 * replicates.log_determinant(correlation);
  };
  double value = misfit(position, fit.tables_evidence().penalty, fit.noise_scale());
  if (design.residuals_per_row() == 6)
    value += misfit(rotation, 0.0, fit.measurements().sigma_rotation);
  return value + fit.charge_for_unknowns(total * design.residuals_per_row());
}

const Candidate* Diagnosis::recommended() const {
  for (const Candidate& c : candidates) {
    if (c.recommend) return &c;
  }
  return nullptr;
}

bool is_beside_table(const Fit& fit, const EffectRequest& request) {
  if (find_effect(request.effect).generic() || request.joints.size() != 1) return false;
  return std::any_of(
      fit.specification().effects.begin(), fit.specification().effects.end(),
      [&](const EffectRequest& other) {
        const Effect& effect = find_effect(other.effect);
        if (!effect.generic() || effect.joint_rule() != JointRule::kEach) return false;
        const std::vector<int> joints =
            other.joints.empty() ? effect.default_joints(fit.context()) : other.joints;
        return std::find(joints.begin(), joints.end(), request.joints.front()) != joints.end();
      });
}

bool is_large(const Fit& fit) {
  return fit.measurements().rows > kLargeCampaign || fit.model().parameters.size() > kLargeModel;
}

Diagnosis diagnose(Fit& fit, const DiagnoseOptions& options, Observer& observer) {
  const auto report = [&](double share, const char* what) { observer.report(share, what); };
  Diagnosis d;
  report(0.0, "linearising");
  const Scorer scorer(fit);
  report(0.1, "scoring the catalogue");
  CandidateBlocks catalogue = catalogue_blocks(fit);
  if (!options.generic) {
    std::erase_if(catalogue.blocks,
                  [](const Block& b) { return find_effect(b.request.effect).generic(); });
  }
  d.untestable = std::move(catalogue.untestable);
  d.spectra = joint_spectra(scorer, fit.state());
  double tried = static_cast<double>(catalogue.blocks.size());
  if (options.generic) add_spectral_blocks(fit, scorer, d.spectra, catalogue.blocks, tried);
  const std::vector<BlockScore> scores = scorer.score(catalogue.blocks);
  d.candidates = best_of_each(catalogue.blocks, scores, std::log10(std::max(1.0, tried)), fit);

  report(0.4, "confirming by refit");
  const double bic = bayesian_information(fit);
  const bool large = is_large(fit);
  const std::size_t most = large ? std::min<std::size_t>(options.confirmed, 3) : options.confirmed;
  const std::vector<std::size_t> promising = promising_of(d.candidates, most);
  Structure structure;
  const std::function<void()> look_for_structure = [&] {
    structure = find_structure(scorer, fit, kStructureSignificant);
  };
  const bool look_at_once = options.look_ahead && !large;
  std::vector<std::size_t> accepted = confirmed_of(fit, bic, d.candidates, promising, report,
                                                   look_at_once ? look_for_structure : nullptr);
  if (accepted.empty()) accepted = hidden_by_tables(fit, scorer, bic, d.candidates);
  d.lack_of_fit = lack_of_fit(scorer, fit);
  if (accepted.empty() && options.look_ahead && d.lack_of_fit.testable &&
      d.lack_of_fit.log10_p < kStructureSignificant) {
    // More is left than noise and nothing known explains it: a gear ratio may not be what it is
    // said to be.
    std::vector<JointSpectrum> wide = wide_joint_spectra(scorer, fit.state());
    std::vector<Block> lines;
    add_spectral_blocks(fit, scorer, wide, lines, tried);
    std::vector<Candidate> found =
        best_of_each(lines, scorer.score(lines), std::log10(std::max(1.0, tried)), fit);
    const std::vector<std::size_t> worth = promising_of(found, 1);
    const std::vector<std::size_t> held = confirmed_of(fit, bic, found, worth, report);
    if (!held.empty()) {
      d.spectra = std::move(wide);
      d.candidates.insert(d.candidates.begin(), found[held.front()]);
      accepted = {0};
    }
  }
  report(0.7, "looking for structure that no effect names");
  if (!look_at_once && accepted.empty()) look_for_structure();
  bool proxy = false;
  if (!accepted.empty()) {
    const std::size_t best = choose(d.candidates, accepted);
    Candidate& winner = d.candidates[best];
    if (find_effect(winner.request.effect).generic()) widen_tables(fit, bic, d.candidates, winner);
    // Where a refit takes seconds the look ahead would take minutes; there the end of a refinement
    // shows what outlives it.
    proxy = options.look_ahead && !large && is_proxy(fit, winner, structure, options);
    winner.recommend = !proxy;
    winner.why = proxy ? "stands in for structure that no effect of the catalogue names"
                       : evidence(winner, fit);
    std::rotate(d.candidates.begin(), d.candidates.begin() + static_cast<std::ptrdiff_t>(best),
                d.candidates.begin() + static_cast<std::ptrdiff_t>(best) + 1);
  }
  for (Candidate& c : d.candidates) {
    if (c.why.empty()) {
      c.why =
          c.log10_p > kSignificant
              ? "not significant among all that was tried"
              : (c.recommend ? evidence(c, fit) : "another candidate explains the residual better");
    }
  }
  if (d.candidates.size() > options.listed) d.candidates.resize(options.listed);
  if (options.look_ahead) name_confounded(scorer, d.candidates);
  d.scatter = scatter_along_joints(scorer, fit);
  if (d.recommended()) {
    d.verdict = Verdict::kMissingEffect;
  } else if (!structure.findings.empty()) {
    d.verdict = Verdict::kUnexplainedStructure;
    d.unexplained = structure.findings;
    d.neighbour_ratio = neighbour_ratio(scorer, fit);
  } else if (d.lack_of_fit.testable && d.lack_of_fit.log10_p < kStructureSignificant) {
    d.verdict = Verdict::kUnexplainedStructure;
    d.neighbour_ratio = neighbour_ratio(scorer, fit);
  }
  d.advice = advise(d, fit);
  report(1.0, "done");
  return d;
}

json Diagnosis::to_json(const Fit& fit) const {
  static const char* const verdicts[] = {"nothing_missing", "missing_effect",
                                         "unexplained_structure"};
  const json document = fit.document();
  json result{
      {"verdict", verdicts[static_cast<int>(verdict)]},
      {"error",
       {{"train", document["error"]["train"]}, {"held_out", document["error"]["held_out"]}}},
      {"noise_floor_um", document["noise_floor"]["um"]},
      {"noise_floor_source", document["noise_floor"]["source"]},
      {"instrument_floor_um", nullptr},
      {"advice", advice},
      {"neighbour_ratio", neighbour_ratio}};
  if (fit.noise_floor().source == "targets") {
    // Distances between reflectors do not hold the arm's repeatability: no noise floor.
    result["instrument_floor_um"] = result["noise_floor_um"];
    result["noise_floor_um"] = nullptr;
    result["noise_floor_source"] = "none";
  }
  result["error"]["cross_validation"] = document["error"]["cross_validation"];
  result["candidates"] = json::array();
  for (const Candidate& c : candidates) {
    json parameters = json::array();
    for (std::size_t i = 0; i < c.parameters.size(); ++i) {
      parameters.push_back({{"name", c.parameters[i].name},
                            {"value", c.parameters[i].value},
                            {"sigma", c.sigma[i]},
                            {"unit", c.parameters[i].unit}});
    }
    result["candidates"].push_back({{"effect", c.request.effect},
                                    {"joints", c.request.joints},
                                    {"options", c.request.options},
                                    {"parameters", parameters},
                                    {"recommend", c.recommend},
                                    {"explained", c.score.explained},
                                    {"log10_p", c.log10_p},
                                    {"delta_bic", c.delta_bic},
                                    {"degrees", c.score.degrees},
                                    {"separability", c.score.separability},
                                    {"confirmed", c.confirmed},
                                    {"held_out_mean_um_if_added", c.held_out_mean * 1e6},
                                    {"confounded_with", c.confounded_with},
                                    {"why", c.why}});
  }
  result["untestable"] = json::array();
  for (const Untestable& u : untestable)
    result["untestable"].push_back({{"effect", u.effect}, {"needs", u.needs}});
  result["unexplained"] = json::array();
  for (const StructureFinding& f : unexplained) {
    std::string variable;
    for (const std::string& v : f.variables) variable += (variable.empty() ? "" : "*") + v;
    result["unexplained"].push_back({{"variable", variable},
                                     {"variables", f.variables},
                                     {"joints", f.joints},
                                     {"coordinate", f.coordinate},
                                     {"log10_p", f.log10_p},
                                     {"explained", f.score.explained},
                                     {"shape", f.shape},
                                     {"curve", {{"x", f.x}, {"y", f.y}}}});
  }
  if (verdict == Verdict::kUnexplainedStructure && unexplained.empty()) {
    result["unexplained"].push_back(
        {{"variable", "none recorded"},
         {"variables", json::array()},
         {"joints", json::array()},
         {"log10_p", lack_of_fit.log10_p},
         {"shape", "more scatter than the " + lack_of_fit.against + " allow"}});
  }
  result["lack_of_fit"] = {{"testable", lack_of_fit.testable},
                           {"against", lack_of_fit.against},
                           {"log10_p", lack_of_fit.log10_p}};
  result["spectra"] = json::array();
  for (const JointSpectrum& s : spectra) {
    result["spectra"].push_back({{"joint", s.joint},
                                 {"resolution", s.resolution},
                                 {"cycles", s.cycles},
                                 {"explained", s.power},
                                 {"amplitude_rad", s.amplitude}});
  }
  return result;
}

}  // namespace armtrue
