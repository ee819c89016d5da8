#include "fitter/diagnose/structure.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "fitter/diagnose/causes/causes.h"
#include "fitter/effects/tables.h"

namespace armtrue {
namespace {

constexpr std::size_t kNodes = 7;
constexpr std::size_t kFewValues = 6;
constexpr double kNearlyAsMuch = 0.9;  // of the first finding's gain
constexpr std::size_t kDescribed = 10, kListed = 5;
constexpr int kStepsTried = 40;
constexpr int kDrawn = 40;  // intervals of a curve
constexpr double kStepExplains = 0.95;
// A smooth function with few nodes blurs a step that lies between two of them, and a function of
// another variable, with a node where the step is, may explain more. So a step is looked for in
// each variable whose smooth function explains this share of the first finding's gain.
constexpr double kMayBeAStep = 0.5;
// BIC in favour of a motor: an effect on a motor can equal one on a coordinate beside it.
constexpr double kMotorFirst = 4.0;
// BIC against a computed variable: a step in an angle cannot be told from one in a load that varies
// with it, so the recorded variable is preferred. (A difference of 2 is not worth more than a bare
// mention: Kass and Raftery 1995, J. Am. Stat. Assoc. 90, 773.)
constexpr double kRecordedFirst = 2.0;
// If one variable alone explains the first share of a pair's gain, the pair is no finding; below
// the second, neither variable makes it alone.
constexpr double kAlone = 0.93, kHalf = 0.5;
constexpr std::size_t kFewColumns = 3;

struct StructureVariable {
  std::string name;
  int joint = 0;               // 0: none
  std::vector<double> values;  // distinct values where they are few
  double middle = 0.0, half = 1.0;
  std::vector<double> nodes;
  bool in_pairs = true;
  bool is_computed = false;
};

std::vector<StructureVariable> variables_of(const State& state) {
  std::vector<std::pair<std::string, int>> names;
  const int n = state.robot().joint_count();
  for (int k = 1; k <= n; ++k) names.emplace_back("q" + std::to_string(k), k);
  for (const char* name : {"payload", "time"}) {
    if (state.recorded(name)) names.emplace_back(name, 0);
  }
  for (const std::string& sensor : state.sensors()) names.emplace_back("dT_" + sensor, 0);
  for (int k = 1; k <= n; ++k) {
    if (state.recorded("dir" + std::to_string(k))) names.emplace_back("dir" + std::to_string(k), k);
  }
  // A user's own columns, beyond the contract's, enter pairs only if they are few: the number of
  // pairs grows with the square.
  const std::size_t of_contract = names.size();
  for (const auto& [name, values] : state.columns()) {
    const auto variable = parse_variable(name, n);
    if (variable && variable->kind == VariableKind::kColumn) names.emplace_back(name, 0);
  }
  const bool few = names.size() - of_contract <= kFewColumns;
  const std::size_t in_pairs = few ? names.size() : of_contract;
  const std::size_t recorded = names.size();
  for (int k = 1; k <= n && state.computes_torque(); ++k) {
    for (const char* stem : {"tau", "gmx", "gmy"}) names.emplace_back(stem + std::to_string(k), k);
  }
  for (int k = 1; k <= n; ++k) {
    // Without coupling the link angle equals the joint angle.
    if (!state.robot().coupling.row(k - 1).isApprox(Eigen::RowVectorXd::Unit(n, k - 1)))
      names.emplace_back("th" + std::to_string(k), k);
  }
  std::vector<StructureVariable> result;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto& [name, joint] = names[i];
    StructureVariable v{name, joint, {}, 0.0, 1.0, {}, i < in_pairs, i >= recorded};
    std::vector<double> sorted = state.column(name);
    std::sort(sorted.begin(), sorted.end());
    if (sorted.back() - sorted.front() < 1e-9) continue;
    v.middle = (sorted.front() + sorted.back()) / 2.0;
    v.half = (sorted.back() - sorted.front()) / 2.0;
    std::vector<double> distinct = sorted;
    distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
    if (distinct.size() <= kFewValues) {
      v.values = distinct;
      v.nodes = distinct;
    } else {
      for (std::size_t node = 0; node < kNodes; ++node)
        v.nodes.push_back(sorted[node * (sorted.size() - 1) / (kNodes - 1)]);
      v.nodes.erase(std::unique(v.nodes.begin(), v.nodes.end()), v.nodes.end());
    }
    result.push_back(std::move(v));
  }
  return result;
}

std::string scaled(const StructureVariable& v) {
  return "((" + v.name + " - " + Expression::number(v.middle).to_string() + ")/" +
         Expression::number(v.half).to_string() + ")";
}

// Basis of one variable: hats over quantiles, or over the values themselves if they are few.
std::vector<std::string> single_basis(const StructureVariable& v) {
  std::vector<std::string> basis;
  for (std::size_t i = 1; i < v.nodes.size(); ++i)
    basis.push_back(hat_expression(v.name, v.nodes, i));
  return basis;
}

// Basis of a pair: low powers of both variables and their products.
std::vector<std::string> pair_basis(const StructureVariable& a, const StructureVariable& b) {
  const auto powers = [](const StructureVariable& v) {
    std::vector<std::string> result{scaled(v)};
    if (v.values.size() != 2) result.push_back(scaled(v) + "^2");
    return result;
  };
  const std::vector<std::string> pa = powers(a), pb = powers(b);
  std::vector<std::string> basis = pa;
  basis.insert(basis.end(), pb.begin(), pb.end());
  for (const std::string& x : pa) {
    for (const std::string& y : pb) basis.push_back(x + "*" + y);
  }
  return basis;
}

struct Where {
  Coordinate coordinate;
  int joint;
};

std::vector<Where> motors(int joints) {
  std::vector<Where> result;
  for (int k = 1; k <= joints; ++k) result.push_back({motor(k), k});
  return result;
}

std::vector<Where> elsewhere(int joints) {
  std::vector<Where> result;
  for (int k = 1; k <= joints; ++k) {
    for (int c = 0; c < 5; ++c) result.push_back({on_link(k, c), k});
  }
  for (int c = 0; c < 6; ++c) result.push_back({on_base(c), 0});
  return result;
}

StructureFinding make_finding(const std::vector<const StructureVariable*>& variables,
                              const Where& where, const std::vector<std::string>& basis) {
  StructureFinding finding;
  std::set<int> joints;
  for (const StructureVariable* v : variables) {
    finding.variables.push_back(v->name);
    if (v->joint > 0) joints.insert(v->joint);
  }
  if (where.joint > 0) joints.insert(where.joint);
  finding.joints.assign(joints.begin(), joints.end());
  finding.coordinate = to_string(where.coordinate, 1);
  finding.block.request.effect = "custom";
  for (std::size_t i = 0; i < basis.size(); ++i) {
    finding.block.terms.parameters.push_back(
        single_term("custom", {}, "structure_" + finding.coordinate + "_" + std::to_string(i + 1),
                    "", 0.0, where.coordinate, basis[i]));
  }
  return finding;
}

void score_all(const Scorer& scorer, std::vector<StructureFinding>& findings) {
  std::vector<Block> blocks;
  for (const StructureFinding& f : findings) blocks.push_back(f.block);
  const std::vector<BlockScore> scores = scorer.score(blocks, false);
  for (std::size_t i = 0; i < findings.size(); ++i) findings[i].score = scores[i];
}

std::string words_for_unit(double largest, bool angle) {
  char text[64];
  if (angle) {
    std::snprintf(text, sizeof text, "%.0f arcsec", largest * 206264.806);
  } else {
    std::snprintf(text, sizeof text, "%.0f um", largest * 1e6);
  }
  return text;
}

// Subtracts the least-squares line of y over x.
void take_out_line(const std::vector<double>& x, std::vector<double>& y) {
  const auto at = [](const std::vector<double>& v) {
    return Eigen::Map<const Eigen::VectorXd>(v.data(), static_cast<Eigen::Index>(v.size()));
  };
  const Eigen::ArrayXd centred = at(x).array() - at(x).mean();
  const double slope = (centred * at(y).array()).sum() / centred.square().sum();
  const double mean = at(y).mean();
  for (std::size_t i = 0; i < y.size(); ++i)
    y[i] -= mean + slope * centred[static_cast<Eigen::Index>(i)];
}

struct Step {
  double at, height;
  BlockScore score;
};

// The best step at the inner points that divide `low` to `high` into `count` intervals.
Step best_step(const Scorer& scorer, const StructureFinding& finding, const std::string& variable,
               double low, double high, int count) {
  std::vector<Block> steps;
  std::vector<double> places;
  for (int i = 1; i < count; ++i) {
    places.push_back(low + (high - low) * i / count);
    Block block = finding.block;
    block.terms.parameters.resize(1);
    Term& term = block.terms.parameters.front().terms.front();
    term.basis = Expression::parse("sign(" + variable + " - " +
                                   Expression::number(places.back()).to_string() + ")");
    block.searched = 1;
    steps.push_back(std::move(block));
  }
  const std::vector<BlockScore> scores = scorer.score(steps, false);
  const auto best =
      std::max_element(scores.begin(), scores.end(),
                       [](const BlockScore& a, const BlockScore& b) { return a.gain < b.gain; });
  return {places[static_cast<std::size_t>(best - scores.begin())],
          best->coefficient.empty() ? 0.0 : 2.0 * std::abs(best->coefficient.front()), *best};
}

// The step that explains nearly as much as the finding's smooth function; nullopt if none does.
std::optional<Step> find_step(const Scorer& scorer, const StructureFinding& finding,
                              const StructureVariable& variable) {
  const double low = variable.middle - variable.half, high = variable.middle + variable.half;
  const Step coarse = best_step(scorer, finding, variable.name, low, high, kStepsTried);
  if (coarse.score.gain < kStepExplains * finding.score.gain) return std::nullopt;
  const double cell = (high - low) / kStepsTried;
  const Step fine = best_step(scorer, finding, variable.name, coarse.at - cell, coarse.at + cell,
                              2 * kStepsTried);
  return fine.score.gain > coarse.score.gain ? fine : coarse;
}

// Evaluates the finding's function along the first variable, with the second, if any, at `second`.
void draw_curve(StructureFinding& finding, const std::vector<const StructureVariable*>& variables,
                double second) {
  const StructureVariable& first = *variables.front();
  const auto& parameters = finding.block.terms.parameters;
  finding.x.clear();
  for (int i = 0; i <= kDrawn; ++i)
    finding.x.push_back(first.middle + first.half * (2.0 * i / kDrawn - 1.0));
  finding.y.assign(finding.x.size(), 0.0);
  const std::vector<double> held{second};
  for (std::size_t p = 0; p < parameters.size(); ++p) {
    const std::vector<double> values = parameters[p].terms.front().basis.evaluate(
        finding.x.size(), [&](const std::string& name) -> const std::vector<double>& {
          return name == first.name ? finding.x : held;
        });
    for (std::size_t i = 0; i < values.size(); ++i)
      finding.y[i] += finding.score.beyond[p] * values[i];
  }
}

// Draws the finding along the first variable, with the second where that curve varies most: a
// product is flat where one factor is zero. Returns the range of the function over all variables.
double draw(StructureFinding& finding, const std::vector<const StructureVariable*>& variables) {
  double low = std::numeric_limits<double>::infinity(), high = -low, most = -1.0;
  StructureFinding best = finding;
  for (int i = 0; i <= (variables.size() == 2 ? kDrawn : 0); ++i) {
    const StructureVariable& last = *variables.back();
    draw_curve(finding, variables, last.middle + last.half * (2.0 * i / kDrawn - 1.0));
    const auto [least, largest] = std::ranges::minmax(finding.y);
    low = std::min(low, least);
    high = std::max(high, largest);
    if (largest - least > most) {
      most = largest - least;
      best.x = finding.x;
      best.y = finding.y;
    }
  }
  finding = std::move(best);
  return high - low;
}

// Describes the shape of the fitted function.
void describe_shape(StructureFinding& finding,
                    const std::vector<const StructureVariable*>& variables,
                    const std::optional<Step>& step, double share_alone, bool angle) {
  const StructureVariable& first = *variables.front();
  const double over_all = draw(finding, variables);
  // The joint's own zero and scale absorb mean and slope, so only the rest is drawn.
  if (variables.size() == 1 && finding.coordinate == "motor" + first.name.substr(1))
    take_out_line(finding.x, finding.y);
  const auto [low, high] = std::minmax_element(finding.y.begin(), finding.y.end());
  const double range = *high - *low;
  const double largest = variables.size() == 2 ? over_all : range;
  double travel = 0.0, jump = 0.0;
  std::size_t jump_at = 0;
  for (std::size_t i = 1; i < finding.y.size(); ++i) {
    const double rise = finding.y[i] - finding.y[i - 1];
    travel += std::abs(rise);
    if (std::abs(rise) > jump) {
      jump = std::abs(rise);
      jump_at = i;
    }
  }
  char text[160];
  if (step)
    finding.cost =
        std::min(finding.cost, finding.cost + step->score.delta_bic - finding.score.delta_bic);
  if (variables.size() == 2) {
    std::snprintf(text, sizeof text, "a joint function of %s and %s, about %s%s",
                  first.name.c_str(), variables[1]->name.c_str(),
                  words_for_unit(largest, angle).c_str(),
                  share_alone < kHalf ? ", that neither makes alone" : "");
  } else if (step) {
    std::snprintf(text, sizeof text, "a step of %s near %s = %.3g",
                  words_for_unit(step->height, angle).c_str(), first.name.c_str(), step->at);
  } else if (range > 0.0 && jump > 0.35 * range) {
    std::snprintf(text, sizeof text, "a step of %s near %s = %.3g",
                  words_for_unit(largest, angle).c_str(), first.name.c_str(), finding.x[jump_at]);
  } else if (range > 0.0 && travel < 1.15 * range) {
    std::snprintf(text, sizeof text, "%s by %s over the range of %s",
                  finding.y.back() > finding.y.front() ? "rises" : "falls",
                  words_for_unit(largest, angle).c_str(), first.name.c_str());
  } else if (range > 0.0 && travel < 2.3 * range) {
    std::snprintf(text, sizeof text, "one arch of %s over the range of %s",
                  words_for_unit(largest, angle).c_str(), first.name.c_str());
  } else {
    std::snprintf(text, sizeof text, "several waves of %s over the range of %s",
                  words_for_unit(largest, angle).c_str(), first.name.c_str());
  }
  finding.shape = text;
}

// log10 p of the best of `tried` blocks.
double log10_p_among(const BlockScore& score, std::size_t tried) {
  return std::min(0.0, score.log10_p + std::log10(static_cast<double>(tried)));
}

// Whether a coordinate is an angle, not a length.
bool turns(const std::string& coordinate, const Robot& robot) {
  constexpr std::string_view kMotor = "motor";
  if (!coordinate.starts_with(kMotor)) return coordinate.find(".r") != std::string::npos;
  const int joint = std::stoi(coordinate.substr(kMotor.size()));
  return !robot.joints[static_cast<std::size_t>(joint - 1)].prismatic;
}

}  // namespace

Structure find_structure(const Scorer& scorer, const Fit& fit, double threshold) {
  const std::vector<StructureVariable> variables = variables_of(fit.state());
  const int n = fit.robot().joint_count();
  std::vector<StructureFinding> findings;
  std::vector<std::vector<const StructureVariable*>> used;
  const auto offer = [&](const std::vector<const StructureVariable*>& vs, const Where& where) {
    findings.push_back(make_finding(
        vs, where, vs.size() == 1 ? single_basis(*vs[0]) : pair_basis(*vs[0], *vs[1])));
    used.push_back(vs);
  };
  std::vector<std::vector<const StructureVariable*>> sets;
  for (std::size_t a = 0; a < variables.size(); ++a) {
    sets.push_back({&variables[a]});
    for (std::size_t b = a + 1; b < variables.size() && variables[b].in_pairs; ++b) {
      sets.push_back({&variables[a], &variables[b]});
    }
  }
  for (const auto& set : sets) {
    for (const Where& where : motors(n)) offer(set, where);
  }
  score_all(scorer, findings);
  // Anything that moves the tool also shows on the motor side, so links and base are tried only for
  // the variables that did best there, and for those of no joint.
  std::vector<std::size_t> order(findings.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return findings[a].score.delta_bic < findings[b].score.delta_bic;
  });
  std::vector<std::vector<const StructureVariable*>> best_sets;
  for (const std::size_t i : order) {
    if (std::find(best_sets.begin(), best_sets.end(), used[i]) == best_sets.end())
      best_sets.push_back(used[i]);
    if (best_sets.size() == 6) break;
  }
  for (const StructureVariable& v : variables) {
    const std::vector<const StructureVariable*> set{&v};
    if (v.joint == 0 && std::find(best_sets.begin(), best_sets.end(), set) == best_sets.end())
      best_sets.push_back(set);
  }
  const std::size_t on_motors = findings.size();
  for (const auto& set : best_sets) {
    for (const Where& where : elsewhere(n)) offer(set, where);
  }
  std::vector<StructureFinding> more(findings.begin() + static_cast<std::ptrdiff_t>(on_motors),
                                     findings.end());
  score_all(scorer, more);
  std::move(more.begin(), more.end(), findings.begin() + static_cast<std::ptrdiff_t>(on_motors));

  Structure structure;
  structure.tried = sets.size() * static_cast<std::size_t>(6 * n + 6);
  order.resize(findings.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto cost = [&](std::size_t i) {
    return findings[i].score.delta_bic -
           (findings[i].coordinate.starts_with("motor") ? kMotorFirst : 0.0) +
           (used[i].front()->is_computed ? kRecordedFirst : 0.0);
  };
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return cost(a) < cost(b); });
  std::map<std::pair<std::string, std::string>, double> single_gain;  // by variable and coordinate
  for (const StructureFinding& f : findings) {
    if (f.variables.size() == 1) single_gain[{f.variables.front(), f.coordinate}] = f.score.gain;
  }
  for (const std::size_t i : order) {
    StructureFinding& finding = findings[i];
    double alone = 0.0;
    if (finding.variables.size() == 2) {
      for (const std::string& v : finding.variables) {
        const auto single = single_gain.find({v, finding.coordinate});
        if (single != single_gain.end())
          alone = std::max(alone, single->second / finding.score.gain);
      }
      if (alone > kAlone) continue;
    }
    if (finding.score.delta_bic > -10.0) continue;
    const double first = structure.findings.empty() ? 0.0 : structure.findings.front().score.gain;
    if (finding.score.gain < kMayBeAStep * first) continue;
    std::optional<Step> step;
    if (finding.variables.size() == 1 && used[i].front()->values.empty())
      step = find_step(scorer, finding, *used[i].front());
    const double gain = std::max(finding.score.gain, step ? step->score.gain : 0.0);
    if (gain < kNearlyAsMuch * first) continue;
    finding.log10_p = log10_p_among(finding.score, structure.tried);
    if (finding.log10_p > threshold) continue;
    finding.score = scorer.score({finding.block}).front();
    finding.log10_p = log10_p_among(finding.score, structure.tried);
    if (finding.log10_p > threshold) continue;
    finding.cost = cost(i);
    describe_shape(finding, used[i], step, alone, turns(finding.coordinate, fit.robot()));
    structure.findings.push_back(std::move(finding));
    if (structure.findings.size() == kDescribed) break;
  }
  // A step is sharp in its own variable, but not in one that varies with it: findings are sorted by
  // the cost of their best form.
  std::ranges::stable_sort(structure.findings, {}, &StructureFinding::cost);
  if (structure.findings.size() > kListed) structure.findings.resize(kListed);
  // Beside a larger effect these events are not among the best findings; but if they are left out,
  // other effects take their place.
  for (std::optional<StructureFinding> finding :
       {find_new_set_up(scorer, fit), find_knock(scorer, fit), find_swings(scorer, fit.state()),
        find_motion(scorer, fit.state()), find_uneven_spring(scorer, fit),
        find_curved_heat(scorer, fit)}) {
    if (!finding) continue;
    const bool is_cause = finding->tried > 0;
    finding->log10_p = log10_p_among(finding->score, is_cause ? finding->tried : structure.tried);
    // A known cause may stand behind an effect that the fit has already.
    if (is_cause || finding->log10_p < threshold) structure.findings.push_back(*std::move(finding));
  }
  std::ranges::stable_sort(structure.findings, {}, &StructureFinding::cost);
  return structure;
}

}  // namespace armtrue
