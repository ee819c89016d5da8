#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

#include "fitter/diagnose/diagnose.h"
#include "fitter/evidence/blocks.h"
#include "fitter/model/variable.h"

namespace armtrue {
namespace {

// A candidate and a structure have different causes if the candidate keeps the first share of its
// gain beside the structure, and the fitted model cannot reproduce the second share of its columns.
constexpr double kOfAnotherKind = 0.9, kUnlikeTheModel = 0.5;
const std::string kPosture = "posture";

// Names of the variables that a block reads.
std::set<std::string> names_read(const Block& block) {
  std::set<std::string> result;
  for (const Parameter& p : block.terms.parameters) {
    for (const Term& term : p.terms) result.merge(term.basis.variables());
  }
  return result;
}

// What a block depends on: "posture" for angles and loads, "session" for time and temperatures,
// which vary together, else a variable's name ("dir2", "payload", a user's column).
std::set<std::string> causes_read(const Block& block, int joints) {
  std::set<std::string> result;
  for (const std::string& name : names_read(block)) {
    const auto variable = parse_variable(name, joints);
    if (!variable) continue;
    result.insert(variable->is_of_posture()   ? kPosture
                  : variable->is_of_session() ? "session"
                                              : name);
  }
  return result;
}

// An effect whose gain is below this share of that of a smooth function of the same variables does
// not name that function.
constexpr double kMostOfIt = 0.5;
// A smooth function with this share of the best one's gain may be the true one.
constexpr double kAsGood = 0.9;

// Parts of the arm that a block moves: base, link, motor.
std::set<std::pair<Place, int>> bodies_moved(const Block& block) {
  std::set<std::pair<Place, int>> result;
  for (const Parameter& p : block.terms.parameters) {
    for (const Term& term : p.terms) result.insert({term.coordinate.place, term.coordinate.index});
  }
  return result;
}

const Block& first_form(const EvidenceBlock& block) { return block.forms.front().block; }

bool is_of_grid(const Parameter& p) {
  return !p.terms.empty() && p.terms.front().table && p.terms.front().table->axes.size() > 1;
}

// True for a structure that is a smooth function; false for events, which have their own form.
bool is_smooth(const EvidenceBlock& block) {
  return block.structure &&
         first_form(block).terms.parameters.front().terms.front().table.has_value();
}

}  // namespace

double as_nearest_name(const Fit& fit, const EvidenceSummary& evidence, std::size_t b) {
  const SearchResult& search = evidence.search;
  const Block& block = first_form(evidence.blocks[b]);
  const std::set<std::string> reads = names_read(block);
  if (reads.empty() || causes_read(block, fit.robot().joint_count()).contains(kPosture)) return 0.0;
  double best = 0.0, probability = 0.0;
  std::vector<std::size_t> alike;
  for (std::size_t s = 0; s < evidence.blocks.size(); ++s) {
    if (evidence.blocks[s].present && s != b && names_read(first_form(evidence.blocks[s])) == reads)
      return 0.0;
    if (!is_smooth(evidence.blocks[s]) || names_read(first_form(evidence.blocks[s])) != reads)
      continue;
    alike.push_back(s);
    best = std::max(best, search.alone_gain[s]);
    probability += search.inclusion[s];
  }
  const bool same_body = std::ranges::any_of(alike, [&](std::size_t s) {
    return search.alone_gain[s] >= kAsGood * best &&
           bodies_moved(first_form(evidence.blocks[s])) == bodies_moved(block);
  });
  return same_body && search.alone_gain[b] >= kMostOfIt * best ? std::min(1.0, probability) : 0.0;
}

void doubt_beside_structure(const Fit& fit, const EvidenceSummary& evidence,
                            std::vector<Candidate>& candidates, double& nothing) {
  const int joints = fit.robot().joint_count();
  double structure = 0.0;
  std::set<std::string> known;
  std::vector<Eigen::Index> structures;
  for (std::size_t b = 0; b < evidence.blocks.size(); ++b) {
    if (!evidence.blocks[b].structure || !evidence.search.likeliest[b]) continue;
    structure = std::max(structure, evidence.search.gain[b]);
    structures.push_back(static_cast<Eigen::Index>(b));
    known.merge(causes_read(evidence.blocks[b].forms.front().block, joints));
  }
  if (structure == 0.0) return;
  const bool of_posture = known.erase(kPosture) > 0;
  double most = 0.0, least_nothing = 1.0;
  for (Candidate& c : candidates) {
    std::set<std::string> own = causes_read(c.block, joints);
    own.erase(kPosture);
    const bool of_another_kind =
        (c.score.separability >= kUnlikeTheModel || (!of_posture && own.empty())) &&
        std::ranges::all_of(structures, [&](Eigen::Index s) {
          return evidence.search.beyond(s, static_cast<Eigen::Index>(c.evidence_block)) >=
                 kOfAnotherKind;
        });
    const bool runs_with_more =
        std::ranges::any_of(own, [&](const std::string& name) { return !known.contains(name); });
    if (const double named = as_nearest_name(fit, evidence, c.evidence_block); named > 0.0) {
      c.probability = std::max(c.probability, named);
      least_nothing = std::min(least_nothing, 1.0 - c.probability);
      continue;
    }
    const bool apart = c.delta_bic < kShowsAlone && (of_another_kind || runs_with_more);
    if (!apart && c.gain_beside < structure)
      c.probability *= c.gain_beside / (c.gain_beside + structure);
    most = std::max(most, c.probability);
  }
  nothing = std::min(std::max(nothing, 1.0 - most), least_nothing);
}

bool has_grid(const Model& model) { return std::ranges::any_of(model.parameters, is_of_grid); }

GridDoubt::GridDoubt(const Fit& fit, const Linearization& linearization,
                     const EvidenceSummary& evidence)
    : fit_(fit) {
  Block grid;
  std::vector<double> values;
  for (const Parameter& p : fit.model().parameters) {
    if (!is_of_grid(p)) continue;
    grid.terms.parameters.push_back(p);
    values.push_back(p.value);
    for (const TableReference::Axis& axis : p.terms.front().table->axes)
      axes_.insert(axis.variable);
  }
  if (values.empty()) return;
  const Eigen::Map<const Eigen::VectorXd> nodes(values.data(),
                                                static_cast<Eigen::Index>(values.size()));
  by_grid_ = (block_columns(linearization, fit.state(), {&grid, 1}) * nodes).squaredNorm() /
             std::pow(evidence.noise.reading, 2);
}

double GridDoubt::share_left(const Block& block, double gain) const {
  const auto is_known = [&](const std::string& name) {
    const auto variable = parse_variable(name, fit_.robot().joint_count());
    return variable && variable->is_of_posture() &&
           (variable->is_load() || axes_.contains("q" + std::to_string(variable->joint)));
  };
  return gain < by_grid_ && std::ranges::all_of(names_read(block), is_known)
             ? gain / (gain + by_grid_)
             : 1.0;
}

void doubt_beside_grid(const GridDoubt& grid, std::vector<Candidate>& candidates, double& nothing) {
  double most = 0.0;
  bool doubted = false;
  for (Candidate& c : candidates) {
    const double share = grid.share_left(c.block, c.gain_beside);
    c.probability *= share;
    doubted = doubted || share < 1.0;
    most = std::max(most, c.probability);
  }
  if (doubted) nothing = std::max(nothing, 1.0 - most);
}

}  // namespace armtrue
