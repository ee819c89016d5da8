#include "fitter/diagnose/diagnose.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>

#include "fitter/diagnose/advice.h"
#include "fitter/diagnose/extra_blocks.h"
#include "fitter/effects/tables.h"
#include "fitter/evidence/words.h"

namespace armtrue {
namespace {

// Candidates below this probability are improbable.
constexpr double kWorthNaming = 0.02;
// log10 p that makes a residual structured: noise alone reaches it in one campaign of 100 000.
constexpr double kStructureSignificant = -5.0;
// Another candidate is an alternative to a candidate from this share of its gain.
constexpr double kSameExplanation = 0.9;
// A rival that keeps this share of its gain beside a candidate is an effect of its own.
constexpr double kIndependentShare = 0.5;

std::string percent(double share, const char* form = "%.1f %%") {
  char text[32];
  std::snprintf(text, sizeof text, form, 100.0 * share);
  return text;
}

// The mean held-out error with a candidate in the model. The part of the error that the arm's past
// makes stays, since no prediction knows that past, and so does what a candidate of that kind
// explains.
double expected_held_out(const Fit& fit, const Candidate& c) {
  const double now = fit.held_out_error().mean;
  const double with_history = fit.held_out_with_history().errors[0].mean;
  const int joints = fit.robot().joint_count();
  if (std::ranges::any_of(c.parameters,
                          [&](const Parameter& p) { return !is_foreseeable(p, joints); }))
    return now;
  return std::sqrt(std::max(0.0, now * now - c.score.explained * with_history * with_history));
}

Candidate make_candidate(const Fit& fit, const EvidenceSummary& evidence, std::size_t b) {
  const EvidenceBlock& block = evidence.blocks[b];
  const SearchResult& search = evidence.search;
  Candidate c;
  c.request = block.request;
  c.evidence_block = b;
  const auto shape = static_cast<std::size_t>(search.shape[b]);
  const EvidenceForm& form = block.forms[static_cast<std::size_t>(block.search.shapes[shape].form)];
  // Beside another effect that explains the same error, the data do not determine the form. A
  // candidate outside the likeliest set therefore gets the form that is best alone.
  const auto alone = static_cast<std::size_t>(search.alone_shape[b]);
  c.block = search.likeliest[b]
                ? form.block
                : block.forms[static_cast<std::size_t>(block.search.shapes[alone].form)].block;
  c.block.terms.parameters.resize(form.own);
  for (const NonlinearParameter& p : build_effect(fit.context(), c.request).nonlinear) {
    if (!p.option.empty() && c.block.request.options.contains(p.option))
      c.block.request.options[p.option].get_to(c.starts[p.name]);
  }
  c.probability = search.inclusion[b];
  c.gain_beside = std::max(0.0, search.gain[b]);
  c.likeliest = search.likeliest[b];
  c.parameters = c.block.terms.parameters;
  for (std::size_t i = 0; i < c.parameters.size(); ++i) {
    c.parameters[i].value = search.coefficient[b][static_cast<Eigen::Index>(i)];
    c.sigma.push_back(search.sigma[b][static_cast<Eigen::Index>(i)]);
  }
  c.score.coefficient.assign(search.coefficient[b].begin(), search.coefficient[b].end());
  c.score.sigma = c.sigma;
  c.score.degrees = static_cast<int>(block.search.shapes[shape].spread.cols());
  c.score.gain = search.alone_gain[b];
  c.score.explained = std::clamp(search.alone_gain[b] / search.start_squares, 0.0, 1.0);
  c.score.separability = search.separability[b];
  c.score.delta_bic = c.delta_bic = -2.0 * search.alone_log_bayes[b];
  const double freedom = std::max(1.0, evidence.freedom);
  const double after = std::max(1e-12, search.start_squares - search.alone_gain[b]);
  c.score.log10_p = log10_f_survival((c.score.gain / c.score.degrees) / (after / freedom),
                                     c.score.degrees, freedom);
  const auto tried = static_cast<double>(evidence.blocks.size());
  c.log10_p = std::min(0.0, c.score.log10_p + std::log10(tried));
  c.held_out_mean = expected_held_out(fit, c);
  return c;
}

std::vector<Candidate> make_candidates(const Fit& fit, const EvidenceSummary& evidence) {
  std::vector<Candidate> result;
  for (std::size_t b = 0; b < evidence.blocks.size(); ++b) {
    if (!evidence.blocks[b].present && !evidence.blocks[b].structure)
      result.push_back(make_candidate(fit, evidence, b));
  }
  return result;
}

// Forms of one effect (a spring that hardens, one that is soft around zero) have one label:
// in_any_form is the sum of their probabilities.
void add_forms(std::vector<Candidate>& candidates) {
  std::map<std::string, double> of_effect;
  for (const Candidate& c : candidates) of_effect[label(c.request)] += c.probability;
  for (Candidate& c : candidates) c.in_any_form = std::min(1.0, of_effect[label(c.request)]);
}

// Orders by the probability of the effect in any form, then by that of the form, in steps of a
// thousandth. Equally probable and improbable ones are ordered by delta_bic.
void rank(std::vector<Candidate>& candidates) {
  const auto step = [](double p) { return p < kWorthNaming ? 0.0 : std::round(1e3 * p); };
  std::stable_sort(candidates.begin(), candidates.end(),
                   [&](const Candidate& a, const Candidate& b) {
                     return std::tuple{-step(a.in_any_form), -step(a.probability), a.delta_bic} <
                            std::tuple{-step(b.in_any_form), -step(b.probability), b.delta_bic};
                   });
}

// The same effect on some of the same joints is not a rival.
bool is_part_of(const EffectRequest& a, const EffectRequest& b) {
  return a.effect == b.effect && std::any_of(a.joints.begin(), a.joints.end(), [&](int k) {
           return std::find(b.joints.begin(), b.joints.end(), k) != b.joints.end();
         });
}

// Alternatives to a candidate explain nearly as much alone, but little more once the candidate is
// in the model. Two effects that are both present are not alternatives.
void name_confounded(const SearchResult& search, std::vector<Candidate>& candidates) {
  for (Candidate& c : candidates) {
    if (c.delta_bic > 0.0 || (c.probability < kWorthNaming && c.delta_bic > kShowsAlone)) continue;
    for (const Candidate& other : candidates) {
      const std::string name = label(other.request);
      if (&other == &c || is_part_of(other.request, c.request) || name == label(c.request) ||
          other.delta_bic > 0.0 || other.score.gain < kSameExplanation * c.score.gain ||
          std::find(c.confounded_with.begin(), c.confounded_with.end(), name) !=
              c.confounded_with.end())
        continue;
      if (search.beyond(static_cast<Eigen::Index>(c.evidence_block),
                        static_cast<Eigen::Index>(other.evidence_block)) < kIndependentShare)
        c.confounded_with.push_back(name);
    }
  }
}

std::string evidence_words(const Candidate& c, const Fit& fit) {
  char text[256];
  std::snprintf(text, sizeof text,
                "probability %s, explains %s of the squared residual, held-out mean %s -> about %s",
                percent(c.probability, "%.0f %%").c_str(), percent(c.score.explained).c_str(),
                micrometre_words(fit.held_out_error().mean).c_str(),
                micrometre_words(c.held_out_mean).c_str());
  return text;
}

// Finds candidates whose columns are combinations of the fitted ones: adding one changes no
// prediction, so it is not missing. The search can still find one probable: under the priors, a
// large coefficient is likelier as the sum of two than as one, and the slope of a table is likelier
// as one coefficient than as the values of its nodes.
void find_spanned(const Scorer& scorer, const Fit& fit, Diagnosis& d) {
  for (Candidate& c : d.candidates) {
    if (c.probability < kWorthNaming || find_effect(c.request.effect).generic()) continue;
    c.spanned = is_part_of_tables(c.block, fit) || scorer.score({c.block}, false).front().spanned;
    if (!c.spanned) continue;
    const double without = 1.0 - c.probability;
    d.nothing_searched = d.nothing_searched < without ? d.nothing_searched / without : 1.0;
  }
}

// Probability that no candidate is present, apart from those that were left out. Candidates count
// as independent: of two that stand for one another, one is more probably present than that.
double probability_of_no_other(const Diagnosis& d) {
  double none = 1.0;
  for (const Candidate& c : d.candidates) {
    if (!c.spanned && !c.left_out && c.probability >= kWorthNaming) none *= 1.0 - c.probability;
  }
  return none;
}

// Recommends the first candidate if something is probably missing, or if it is almost certain and
// would replace an effect that an earlier search added; with less certainty the earlier one stays.
// The probability that nothing else is missing includes that of left-out candidates, but is no
// larger than what the other candidates leave, since left-out ones may be present beside them.
void recommend(Diagnosis& d) {
  const auto first = std::ranges::find_if(
      d.candidates, [](const Candidate& c) { return !c.spanned && !c.left_out; });
  if (first == d.candidates.end()) return;
  double left_out = 0.0;
  for (const Candidate& c : d.candidates) left_out += c.left_out ? c.probability : 0.0;
  const double nothing_else =
      std::clamp(probability_of_no_other(d), d.nothing_searched, d.nothing_searched + left_out);
  first->recommend = nothing_else < kMoreLikelyThanNot || first->in_any_form >= kSurely;
}

// Why a candidate that is significant alone is improbable, beside the recommended one.
std::string why_improbable(const Candidate& c, const Diagnosis& d) {
  const Candidate* best = d.recommended();
  if (!best) return "an alternative, or not surely seen in these data";
  const std::string first = label(best->request);
  if (c.score.explained <= best->score.explained)
    return first + " explains more of the squared residual";
  std::string likelier = first;
  std::size_t parameters = best->parameters.size();
  for (const Candidate& other : d.candidates) {
    if (&other == best || !other.likeliest || other.probability < kMoreLikelyThanNot) continue;
    likelier += " + " + label(other.request);
    parameters += other.parameters.size();
  }
  const std::string more =
      "explains more than " + first + ", but with " + std::to_string(c.parameters.size());
  if (c.parameters.size() <= parameters)
    return "explains more than " + first +
           ", but is less probable: the usual size of such an effect, and joints that repeat "
           "badly, count as well";
  return likelier == first ? more + " parameters instead of " + std::to_string(parameters)
                           : more + " parameters; more probable are " + likelier + ", with " +
                                 std::to_string(parameters);
}

// The effects of the fit that are improbable, because a candidate is probable in their place.
std::string replaced_words(const Diagnosis& d) {
  std::string words;
  for (const Superfluous& s : d.superfluous)
    words += (words.empty() ? "" : ", ") + label(s.request);
  return words.empty() ? "an effect of the fit" : words;
}

void explain(Diagnosis& d, const Fit& fit) {
  for (Candidate& c : d.candidates) {
    c.why = c.spanned ? "the data cannot tell it from what is fitted already"
            : c.left_out && c.instead
                ? "was fitted and left out: in place of an effect of the fit it predicts unseen "
                  "poses no better"
            : c.left_out ? "was fitted and left out, for it predicts unseen poses no better"
            : c.instead  ? "probable in place of " + replaced_words(d) + ", not beside it"
            : c.recommend || c.probability > kMoreLikelyThanNot ? evidence_words(c, fit)
            : c.probability > kWorthNaming ? "an alternative, or not surely seen in these data"
            : c.delta_bic < 0.0            ? why_improbable(c, d)
                                           : "these data show nothing of it";
  }
}

// Forms of one effect have one label, whose probability is the sum of theirs. A form that another
// form would replace is superfluous nevertheless.
void describe_present(const Fit& fit, const EvidenceSummary& evidence, const GridDoubt& grid,
                      Diagnosis& d) {
  std::map<std::string, double> in_any_form;
  std::vector<double> inclusion = evidence.search.inclusion;
  for (std::size_t b = 0; b < evidence.blocks.size(); ++b) {
    const EvidenceBlock& block = evidence.blocks[b];
    if (!block.believed)
      inclusion[b] *= grid.share_left(block.forms.front().block, evidence.search.gain[b]);
    in_any_form[block.label] += inclusion[b];
  }
  for (std::size_t b = 0; b < evidence.blocks.size(); ++b) {
    if (!evidence.blocks[b].present) continue;
    const double by_cause = as_nearest_name(fit, evidence, b);
    const double probability = std::max(inclusion[b], by_cause);
    d.probability_present[evidence.blocks[b].label] =
        std::clamp(in_any_form[evidence.blocks[b].label], by_cause, 1.0);
    if (probability < kMoreLikelyThanNot)
      d.superfluous.push_back({evidence.blocks[b].request, probability});
  }
  std::stable_sort(
      d.superfluous.begin(), d.superfluous.end(),
      [](const Superfluous& a, const Superfluous& b) { return a.probability < b.probability; });
}

// Structures with evidence against them. The evidence allows for joints that repeat worse than
// others; the test that found the structures does not.
std::set<std::size_t> improbable_findings(const EvidenceSummary& evidence) {
  std::set<std::size_t> result;
  for (std::size_t b = 0; b < evidence.blocks.size(); ++b) {
    if (evidence.blocks[b].structure && evidence.search.alone_log_bayes[b] < 0.0)
      result.insert(evidence.blocks[b].finding);
  }
  return result;
}

void recommend_beside(Diagnosis& d, const std::set<std::string>& left_out) {
  for (Candidate& c : d.candidates) {
    c.left_out = left_out.contains(key_of(c.request));
    c.recommend = false;
  }
  recommend(d);
}

// Returns which structures in `extra` are improbable.
std::set<std::size_t> weigh(Fit& fit, const Linearization& linearization, const Scorer& scorer,
                            std::vector<EvidenceBlock> extra, const DiagnoseOptions& options,
                            Diagnosis& d) {
  EvidenceOptions weighing;
  weighing.searched = options.searched;
  const EvidenceSummary evidence =
      weigh_evidence(fit, linearization, catalogue_blocks(fit), std::move(extra), weighing);
  d.untestable = untestable_effects(fit.context());
  d.noise = evidence.noise;
  d.reading_sigma = evidence.noise.reading * linearization.typical_sigma;
  d.orientation_sigma = evidence.noise.orientation * linearization.sigma_rotation;
  d.nothing_searched = evidence.search.nothing_missing;
  d.candidates = make_candidates(fit, evidence);
  doubt_beside_structure(fit, evidence, d.candidates, d.nothing_searched);
  const GridDoubt grid(fit, linearization, evidence);
  doubt_beside_grid(grid, d.candidates, d.nothing_searched);
  add_forms(d.candidates);
  rank(d.candidates);
  find_spanned(scorer, fit, d);
  describe_present(fit, evidence, grid, d);
  name_confounded(evidence.search, d.candidates);
  recommend_beside(d, options.left_out);
  return improbable_findings(evidence);
}

// Shares of the squared residual as the charts draw them: of each candidate alone, all rows
// weighted as in the fit. Tables keep the search's shares, which allow for their smoothness.
void score_alone(const Scorer& scorer, const Fit& fit, std::vector<Candidate>& candidates) {
  std::vector<Block> blocks;
  std::vector<Candidate*> of_block;
  for (Candidate& c : candidates) {
    if (find_effect(c.request.effect).generic()) continue;
    blocks.push_back(c.block);
    of_block.push_back(&c);
  }
  const std::vector<BlockScore> scores = scorer.score(blocks);
  for (std::size_t i = 0; i < scores.size(); ++i) {
    of_block[i]->score.explained = scores[i].explained;
    of_block[i]->score.gain = scores[i].gain;
    of_block[i]->score.separability = scores[i].separability;
    of_block[i]->held_out_mean = expected_held_out(fit, *of_block[i]);
  }
}

bool is_unlike_noise(const LackOfFit& lack) {
  return lack.testable && lack.log10_p < kStructureSignificant;
}

// Probability that nothing is missing, and which candidates are probable only in place of effects
// of the fit. A recommended candidate is missing even if an effect of the fit stands for it now.
// If the search was not sure of what held-out poses then refused, the two leave it undecided.
void weigh_nothing(Diagnosis& d) {
  d.probability_nothing = d.nothing_searched;
  const auto contradicts = [](const Candidate& c) {
    return c.left_out && !c.spanned && c.in_any_form >= kSurely;
  };
  const bool is_undecided =
      !d.recommended() && d.left_out() && std::ranges::none_of(d.candidates, contradicts);
  for (Candidate& c : d.candidates) {
    if (!is_undecided || !c.left_out) continue;
    c.probability = std::min(c.probability, kMoreLikelyThanNot);
    c.in_any_form = std::min(c.in_any_form, kMoreLikelyThanNot);
    d.probability_nothing = std::max(d.probability_nothing, kMoreLikelyThanNot);
  }
  const bool represented = d.nothing_searched >= kMoreLikelyThanNot;
  for (Candidate& c : d.candidates) {
    c.instead = represented && !c.spanned && !c.recommend && c.in_any_form > kMoreLikelyThanNot;
    if (c.recommend || (!represented && !c.spanned && c.probability > kMoreLikelyThanNot))
      d.probability_nothing = std::min(d.probability_nothing, 1.0 - c.in_any_form);
  }
  if (d.has_structure() && !d.recommended())
    d.probability_nothing = std::min(d.probability_nothing, std::pow(10.0, kStructureSignificant));
}

// Whether a joint repeats worse than others.
bool stands_out(const NoiseParts& noise, std::size_t joint) {
  return !noise.is_pooled(joint) && noise.joint[joint] > 0.0;
}

bool any_stands_out(const NoiseParts& noise) {
  for (std::size_t k = 0; k < noise.joint.size(); ++k) {
    if (stands_out(noise, k)) return true;
  }
  return false;
}

// True if the scatter of a joint that repeats badly contains a line: waves finer than the first
// spectra resolve look like scatter of their joint.
bool has_line_in_scatter(const std::vector<JointSpectrum>& spectra, const NoiseParts& noise,
                         std::size_t rows) {
  return std::ranges::any_of(spectra, [&](const JointSpectrum& spectrum) {
    const auto joint = static_cast<std::size_t>(spectrum.joint - 1);
    return stands_out(noise, joint) && !spectrum.power.empty() &&
           is_no_chance(spectrum, *std::ranges::max_element(spectrum.power), rows);
  });
}

// Looks for finer lines if the residual exceeds noise, or a joint repeats badly, and no effect
// explains it: a gear ratio may be unknown or wrong. Replaces `d` by the diagnosis with finer lines
// if that recommends an effect.
void look_for_finer_lines(Fit& fit, const Linearization& linearization, const Scorer& scorer,
                          const Structure& structure, const DiagnoseOptions& options,
                          Diagnosis& d) {
  const bool unlike_noise = is_unlike_noise(d.lack_of_fit);
  if (!unlike_noise && (d.rounding.size > 0.0 || !any_stands_out(d.noise))) return;
  std::vector<JointSpectrum> wide = wide_joint_spectra(linearization, fit.state());
  if (!unlike_noise && !has_line_in_scatter(wide, d.noise, linearization.rows())) return;
  Diagnosis other;
  std::vector<EvidenceBlock> lines = spectral_blocks(fit, linearization, wide);
  for (EvidenceBlock& block : structure_blocks(fit, structure)) lines.push_back(std::move(block));
  weigh(fit, linearization, scorer, std::move(lines), options, other);
  if (!other.recommended()) return;
  other.lack_of_fit = d.lack_of_fit;
  d = std::move(other);
  d.spectra = std::move(wide);
}

}  // namespace

const Candidate* Diagnosis::recommended() const {
  for (const Candidate& c : candidates) {
    if (c.recommend) return &c;
  }
  return nullptr;
}

const Candidate* Diagnosis::left_out() const {
  const auto found = std::ranges::find_if(candidates, &Candidate::left_out);
  return found == candidates.end() ? nullptr : &*found;
}

bool Diagnosis::has_structure() const {
  return !structure.empty() || is_unlike_noise(lack_of_fit) || gross;
}

std::span<const StructureFinding> Diagnosis::unexplained() const {
  if (verdict != Verdict::kUnexplainedStructure) return {};
  return structure;
}

std::string key_of(const EffectRequest& request) { return label(request) + request.options.dump(); }

// If probable candidates were fitted and held-out poses did not confirm them, the residual has a
// structure that no effect of the catalogue explains.
void conclude(Diagnosis& d, const Fit& fit, const Linearization& linearization) {
  weigh_nothing(d);
  explain(d, fit);
  d.verdict = d.recommended()                              ? Verdict::kMissingEffect
              : d.probability_nothing < kMoreLikelyThanNot ? Verdict::kUnexplainedStructure
                                                           : Verdict::kNothingMissing;
  if (d.verdict == Verdict::kUnexplainedStructure)
    d.neighbour_ratio = neighbour_ratio(linearization, fit.state());
  d.advice = advise(d, fit, linearization);
}

bool conclude_beside(Diagnosis& d, Fit& fit, const std::set<std::string>& left_out) {
  recommend_beside(d, left_out);
  if (!d.recommended()) return false;
  conclude(d, fit, linearize(fit));
  return true;
}

Diagnosis diagnose(Fit& fit, const DiagnoseOptions& options, Observer& observer) {
  const auto report = [&](double share, const char* what) { observer.report(share, what); };
  Diagnosis d;
  report(0.0, "linearising");
  const Linearization linearization = linearize(fit);
  const Scorer scorer(fit, linearization);
  report(0.1, "looking for periods and structure");
  d.spectra = joint_spectra(linearization, fit.state());
  Structure structure = find_structure(scorer, fit, kStructureSignificant);
  std::vector<EvidenceBlock> extra = spectral_blocks(fit, linearization, d.spectra);
  for (EvidenceBlock& block : structure_blocks(fit, structure)) extra.push_back(std::move(block));
  report(0.4, "weighing the catalogue");
  const std::set<std::size_t> improbable =
      weigh(fit, linearization, scorer, std::move(extra), options, d);
  d.rounding = rounding_of_joints(d.noise, fit);
  // Repeats of a pose have the same rounded angles in the file. Their scatter does not contain the
  // rounding error, which differs from pose to pose, so lack of fit is not tested against it.
  if (d.rounding.size == 0.0) d.lack_of_fit = lack_of_fit(linearization, fit, d.noise);
  if (!d.recommended()) look_for_finer_lines(fit, linearization, scorer, structure, options, d);
  if (d.candidates.size() > options.listed) d.candidates.resize(options.listed);
  score_alone(scorer, fit, d.candidates);
  for (std::size_t f = 0; f < structure.findings.size(); ++f) {
    const StructureFinding& finding = structure.findings[f];
    if (!improbable.contains(f) && finding.log10_p < kStructureSignificant)
      d.structure.push_back(finding);
  }
  d.scatter = scatter_along_joints(linearization, fit);
  const GrossCluster gross = gross_errors_together(fit);
  if (gross.log10_p < kStructureSignificant) d.gross = gross;
  d.tables = tables_of(fit);
  conclude(d, fit, linearization);
  report(1.0, "done");
  return d;
}

}  // namespace armtrue
