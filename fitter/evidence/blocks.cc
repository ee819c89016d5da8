#include "fitter/evidence/blocks.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "fitter/common/dense.h"
#include "fitter/common/parallel.h"
#include "fitter/evidence/prior_shapes.h"
#include "fitter/evidence/refit.h"
#include "fitter/model/variable.h"

namespace armtrue {
namespace {

// Prior odds of a kind of effect, shared by its joints, pairs and periods (docs/decisions/0006).
constexpr double kKindOdds = 0.03;
// A joint's table can follow any error of that joint, so its prior odds are smaller by this factor.
constexpr double kCauseBeforeTable = 10.0;
// Prior odds of effects that the user put into the model.
constexpr double kBelievedOdds = 3.0;
// Prior of a nonlinear parameter around its fitted value: its range is this many standard
// deviations.
constexpr double kRangeIsSigmas = 20.0;
// A table finer than the spacing of the poses would follow the scatter of each pose, and the time
// of a search grows with the third power of the number of nodes.
constexpr double kPosesPerNode = 3.0;
constexpr double kFewestNodes = 12.0, kMostNodes = 100.0, kFinestSpacing = 0.035;
constexpr Eigen::Index kCostlyDirections = 12;
// A column explains this much of the squared residual by chance, in variances of a reading.
constexpr double kByChance = 4.0;
constexpr double kSlightest = 1e-9;

bool is_geometry(const std::string& effect) {
  const Role role = find_effect(effect).role();
  return role == Role::kPlacement || role == Role::kGeometry;
}

bool is_joint_table(const EffectRequest& request) {
  const Effect& effect = find_effect(request.effect);
  return effect.generic() && effect.joint_rule() == JointRule::kEach;
}

// True if a term of the block reads a gravity regressor of a link: the load of one unit of a mass
// parameter.
bool reads_link_masses(const Block& block, int joints) {
  return std::ranges::any_of(block.terms.parameters, [&](const Parameter& p) {
    return std::ranges::any_of(p.terms, [&](const Term& term) {
      return std::ranges::any_of(term.basis.variables(), [&](const std::string& name) {
        const auto v = parse_variable(name, joints);
        return v && v->link > 0 &&
               (v->kind == VariableKind::kTorqueRegressor ||
                v->kind == VariableKind::kMomentRegressor);
      });
    });
  });
}

class Builder {
 public:
  Builder(Fit& fit, const Linearization& linearization) : fit_(fit), l_(linearization) {}

  std::vector<EvidenceBlock> candidates(std::vector<Block> catalogue) {
    add_present();
    add_catalogue(std::move(catalogue));
    add_all_slopes(fit_.context(), model_.blocks);
    for (EvidenceBlock& block : model_.blocks) {
      if (block.present && block.forms.size() > 1) drop_better_forms(block);
      for (EvidenceForm& form : block.forms)
        form.log_prior = -std::log(static_cast<double>(block.forms.size()));
    }
    return std::move(model_.blocks);
  }

  EvidenceModel build(std::vector<EvidenceBlock> blocks) {
    model_.blocks = std::move(blocks);
    make_base();
    make_columns();
    set_odds();
    return std::move(model_);
  }

 private:
  void add_present();
  void add_catalogue(std::vector<Block> catalogue);
  void make_base();
  bool work_out(EvidenceBlock& block) const;
  void make_columns();
  void set_odds();
  Block present_form(const EffectRequest& request);
  std::vector<EvidenceForm> present_forms(const EffectRequest& request);
  void drop_better_forms(EvidenceBlock& block) const;
  Block table_form(const EffectRequest& request) const;
  const std::string& name_of(Eigen::Index column) const;
  std::vector<Eigen::Index> columns_of(const EffectRequest& request) const;

  Fit& fit_;
  const Linearization& l_;
  EvidenceModel model_;
};

// Name of the parameter that a column of Linearization::jacobian belongs to.
const std::string& Builder::name_of(Eigen::Index column) const {
  const std::vector<int>& free = fit_.design().free_parameters();
  const auto unknown = static_cast<std::size_t>(l_.unknown[static_cast<std::size_t>(column)]);
  return unknown < free.size()
             ? fit_.model().parameters[static_cast<std::size_t>(free[unknown])].name
             : fit_.model().nonlinear[unknown - free.size()].name;
}

// Columns of Linearization::jacobian of an effect, nonlinear parameters included. They are found by
// name, because entries of one effect may share joints and differ in pairs or orders only.
std::vector<Eigen::Index> Builder::columns_of(const EffectRequest& request) const {
  const EffectTerms effect = build_effect(fit_.context(), request);
  std::set<std::string> names;
  for (const Parameter& p : effect.parameters) names.insert(p.name);
  for (const NonlinearParameter& p : effect.nonlinear) names.insert(p.name);
  std::vector<Eigen::Index> result;
  for (Eigen::Index c = 0; c < static_cast<Eigen::Index>(l_.unknown.size()); ++c) {
    if (names.contains(name_of(c))) result.push_back(c);
  }
  return result;
}

// The parameters of an effect of the fit, nonlinear ones at their present values. Those that the
// fit holds as not identifiable are included: in another set of effects the data may determine
// them. Parameters that the model lacks are skipped: mass parameters depend on the springs, and the
// fit may have found springs that it did not have when it began.
Block Builder::present_form(const EffectRequest& request) {
  Block form{request, {}, 0};
  std::map<std::string, double> values;
  for (const NonlinearParameter& p : fit_.model().nonlinear) values[p.name] = p.value;
  for (const Parameter& own : build_effect(fit_.context(), request).parameters) {
    const auto p = std::ranges::find(fit_.model().parameters, own.name, &Parameter::name);
    if (p == fit_.model().parameters.end() || p->fixed) continue;
    form.terms.parameters.push_back(*p);
    for (Term& term : form.terms.parameters.back().terms)
      term.basis = term.basis.substitute(values);
  }
  const auto linear = fit_.design().free_parameters().size();
  for (const Eigen::Index c : columns_of(request)) {
    const auto unknown = static_cast<std::size_t>(l_.unknown[static_cast<std::size_t>(c)]);
    if (unknown < linear) continue;
    const NonlinearParameter& p = fit_.model().nonlinear[unknown - linear];
    Parameter slope;
    slope.name = p.name;
    slope.effect = p.effect;
    slope.joints = p.joints;
    slope.prior_sigma = (p.upper - p.lower) / kRangeIsSigmas;
    form.terms.parameters.push_back(slope);
  }
  return form;
}

// The fitted form of an effect of the fit, and all forms that it would have as a candidate. With
// the fitted form alone, an effect would seem less probable in the fit than as a candidate, because
// the fitted form may be the least probable of several that fit equally well.
std::vector<EvidenceForm> Builder::present_forms(const EffectRequest& request) {
  EffectRequest found = request;
  for (const NonlinearParameter& p : build_effect(fit_.context(), request).nonlinear) {
    const auto& all = fit_.model().nonlinear;
    const auto own = std::ranges::find(all, p.name, &NonlinearParameter::name);
    if (!p.option.empty() && own != all.end()) found.options[p.option] = own->value;
  }
  std::vector<EvidenceForm> forms{present_form(request)};
  if (found.options == request.options) return forms;
  forms.front().found = true;
  forms.front().block.request.options = found.options;
  for (const EffectRequest& candidate : find_effect(request.effect).tried(fit_.context())) {
    const EffectRequest added = as_added(candidate);
    if (added.options != candidate.options && label(added) == label(request) &&
        added.options == request.options && candidate.options != found.options)
      forms.emplace_back(make_block(fit_.context(), candidate));
  }
  return forms;
}

// Drops forms that explain clearly more than the fitted one. Such a form imitates another effect by
// its slopes: if values of its own parameters explained as much, the fit would have found them.
void Builder::drop_better_forms(EvidenceBlock& block) const {
  std::vector<EvidenceForm> kept{block.forms.front()};
  for (std::size_t f = 1; f < block.forms.size(); ++f) {
    const Eigen::MatrixXd columns = block_columns(l_, fit_.state(), {&block.forms[f].block, 1});
    const Eigen::MatrixXd own = columns - l_.jacobian * least_squares(l_.jacobian, columns);
    const Eigen::VectorXd left = -l_.residual;
    const Eigen::VectorXd solution = least_squares(own, left, kSlightest);
    const double gain = left.dot(own * solution);
    if (gain < kByChance * static_cast<double>(columns.cols())) kept.push_back(block.forms[f]);
  }
  block.forms = std::move(kept);
}

// A joint's table with nodes as fine as the poses can resolve; the search chooses its smoothness.
Block Builder::table_form(const EffectRequest& request) const {
  EffectRequest fine = request;
  const std::vector<double>& q = fit_.state().column("q" + std::to_string(request.joints.front()));
  const auto [low, high] = std::minmax_element(q.begin(), q.end());
  const double nodes = std::clamp(l_.poses.poses / kPosesPerNode, kFewestNodes, kMostNodes);
  fine.options["spacing"] = std::max(kFinestSpacing, (*high - *low) / nodes);
  return make_block(fit_.context(), fine);
}

void Builder::add_present() {
  for (const EffectRequest& request : removable_effects(fit_)) {
    EvidenceBlock block;
    block.request = as_added(request);
    block.label = label(request);
    block.kind = request.effect;
    block.present = block.search.present = true;
    if (is_joint_table(request)) {
      // make_base() adds back the contribution of the fit's own nodes.
      block.forms = {EvidenceForm(table_form(request))};
    } else {
      block.forms = present_forms(request);
    }
    if (block.forms.empty() || block.forms.front().block.terms.parameters.empty()) continue;
    // If masses are given, such terms are corrections of them, with informative priors.
    block.unknown_load = !fit_.state().computes_torque() &&
                         reads_link_masses(block.forms.front().block, fit_.robot().joint_count());
    model_.blocks.push_back(std::move(block));
  }
}

void Builder::add_catalogue(std::vector<Block> catalogue) {
  std::map<std::string, std::size_t> by_label;
  for (Block& candidate : catalogue) {
    const EffectRequest added = as_added(candidate.request);
    const std::string key = label(added) + added.options.dump();
    const auto [at, fresh] = by_label.try_emplace(key, model_.blocks.size());
    if (fresh) {
      EvidenceBlock block;
      block.request = added;
      block.label = label(added);
      block.kind = added.effect;
      model_.blocks.push_back(std::move(block));
    }
    EvidenceBlock& block = model_.blocks[at->second];
    if (!is_joint_table(added)) {
      block.forms.emplace_back(std::move(candidate));
    } else if (block.forms.empty()) {
      block.forms = {EvidenceForm(table_form(added))};
    }
  }
}

// Base: columns and priors of everything that is not a block, and the gradient of these priors.
void Builder::make_base() {
  std::set<Eigen::Index> taken;
  model_.y = -l_.residual + l_.from_tables;
  const std::vector<double> values = fit_.design().unknown_values();
  for (const EvidenceBlock& block : model_.blocks) {
    if (!block.present || is_joint_table(block.request)) continue;
    for (const Eigen::Index c : columns_of(block.request)) {
      taken.insert(c);
      const auto unknown = static_cast<std::size_t>(l_.unknown[static_cast<std::size_t>(c)]);
      // The column of a nonlinear parameter stands for changes from its present value.
      if (unknown < fit_.design().free_parameters().size())
        model_.y += l_.jacobian.col(c) * values[unknown];
    }
  }
  std::vector<Eigen::Index> kept;
  std::map<int, Eigen::Index> place;  // column in the base, by unknown
  for (Eigen::Index c = 0; c < l_.jacobian.cols(); ++c) {
    if (taken.contains(c)) continue;
    place[l_.unknown[static_cast<std::size_t>(c)]] = static_cast<Eigen::Index>(kept.size());
    kept.push_back(c);
  }
  // Geometry that the fit holds as not identifiable is still uncertain: it enters with its prior.
  Block held;
  for (std::size_t i = 0; i < fit_.model().parameters.size(); ++i) {
    const Parameter& p = fit_.model().parameters[i];
    if (!p.fixed && is_geometry(p.effect) && p.prior_sigma > 0.0 &&
        fit_.design().unknown_of(static_cast<int>(i)) < 0)
      held.terms.parameters.push_back(p);
  }
  const auto own = static_cast<Eigen::Index>(kept.size());
  const auto more = static_cast<Eigen::Index>(held.terms.parameters.size());
  // Loads act at the commanded angles or at those of the deflected arm. The fit chose one of the
  // two while effects were missing, perhaps wrongly. by_other_loads is the change to the other: a
  // coefficient of 0 keeps the choice, 1 reverses it.
  const Eigen::Index width = own + more + (l_.by_other_loads.size() > 0 ? 1 : 0);
  model_.base.resize(l_.equations(), width);
  model_.base.leftCols(own) = l_.jacobian(Eigen::all, kept);
  if (more > 0) model_.base.middleCols(own, more) = block_columns(l_, fit_.state(), {&held, 1});
  model_.base_precision = Eigen::MatrixXd::Zero(width, width);
  model_.base_pull = Eigen::VectorXd::Zero(width);
  if (width > own + more) {
    model_.base.col(width - 1) = l_.by_other_loads;
    model_.base_precision(width - 1, width - 1) = 1.0;  // prior of the coefficient: 0 ± 1
  }
  for (Eigen::Index c = 0; c < more; ++c) {
    model_.base_precision(own + c, own + c) =
        std::pow(held.terms.parameters[static_cast<std::size_t>(c)].prior_sigma, -2);
  }
  for (const PenaltyRow& row : penalty_rows(fit_.design(), fit_.smoothness_sigma())) {
    if (!std::all_of(row.entries.begin(), row.entries.end(),
                     [&](const auto& entry) { return place.contains(entry.first); }))
      continue;
    const double left = row.residual(values);
    model_.base_pull_squares += left * left;
    for (const auto& [ua, fa] : row.entries) {
      model_.base_pull[place[ua]] += fa * left;
      for (const auto& [ub, fb] : row.entries)
        model_.base_precision(place[ua], place[ub]) += fa * fb;
    }
  }
}

// Computes columns and prior shapes of one block; false if it has no usable ones.
bool Builder::work_out(EvidenceBlock& block) const {
  const Block& first_form = block.forms.front().block;
  const bool table = !first_form.terms.parameters.front().terms.empty() &&
                     first_form.terms.parameters.front().terms.front().table.has_value();
  std::vector<Block> forms;
  for (const EvidenceForm& form : block.forms) forms.push_back(form.block);
  block.columns = block_columns(l_, fit_.state(), forms);
  if (block.present && !table) {
    // The first form is the fitted one.
    for (const Eigen::Index c : columns_of(block.request)) {
      const auto& all = first_form.terms.parameters;
      const auto own = std::ranges::find(all, name_of(c), &Parameter::name);
      block.columns.col(own - all.begin()) = l_.jacobian.col(c);
    }
  }
  if (!(block.columns.squaredNorm() > 0.0) || !block.columns.allFinite()) return false;
  std::vector<PriorShape>& shapes = block.search.shapes;
  if (table) {
    add_table_shapes(first_form, !block.structure, block.columns, l_, shapes);
  } else {
    Eigen::Index at = 0;
    for (const EvidenceForm& form : block.forms) {
      const auto own = static_cast<Eigen::Index>(form.block.terms.parameters.size());
      Eigen::VectorXd displacement(own);
      double known_size = 0.0;
      for (Eigen::Index c = 0; c < own; ++c) {
        displacement[c] = l_.displacement(block.columns.col(at + c));
        const double value = form.block.terms.parameters[static_cast<std::size_t>(c)].value;
        if (block.present) known_size = std::max(known_size, std::abs(value) * displacement[c]);
      }
      const std::size_t before = shapes.size();
      add_shapes(form, displacement, known_size, at, block.columns.cols(), shapes);
      for (std::size_t s = before; s < shapes.size(); ++s) {
        shapes[s].form = static_cast<int>(&form - block.forms.data());
        shapes[s].carries = carrying_of(form, fit_);
      }
      at += own;
    }
  }
  if (shapes.empty()) return false;
  // The forms of one effect span nearly the same space; the nodes of a table do not.
  if (!table) block.columns = compress(block.columns, shapes);
  // The masses of all links have as many directions as a table, but are one cause: they compete
  // with effects of few directions.
  block.search.costly = table && std::ranges::any_of(shapes, [](const PriorShape& shape) {
                          return shape.spread.cols() > kCostlyDirections;
                        });
  return true;
}

void Builder::make_columns() {
  Eigen::Index width = 0;
  std::vector<EvidenceBlock> used;
  std::vector<char> stands(model_.blocks.size());
  in_parallel(model_.blocks.size(), [&](std::size_t b) {
    EvidenceBlock& block = model_.blocks[b];
    stands[b] = block.columns.size() > 0 || work_out(block) ? 1 : 0;
  });
  for (std::size_t b = 0; b < model_.blocks.size(); ++b) {
    EvidenceBlock& block = model_.blocks[b];
    if (stands[b] == 0) continue;
    block.search.present = block.present;
    block.search.replaceable = block.present && !block.believed;
    block.search.counts = !block.structure;
    block.search.first = width;
    block.search.width = block.columns.cols();
    width += block.columns.cols();
    used.push_back(std::move(block));
  }
  model_.blocks = std::move(used);
}

void Builder::set_odds() {
  std::map<std::string, double> of_kind;
  for (const EvidenceBlock& block : model_.blocks) {
    if (block.tried == 0.0) of_kind[block.kind] += 1.0;
  }
  for (EvidenceBlock& block : model_.blocks) {
    double odds = kKindOdds / (block.tried > 0.0 ? block.tried : of_kind[block.kind]);
    if (is_joint_table(block.request)) odds /= kCauseBeforeTable;
    odds *= find_effect(block.request.effect).relative_odds();
    block.search.log_odds = std::log(block.believed ? kBelievedOdds : odds);
  }
}

}  // namespace

Eigen::MatrixXd block_columns(const Linearization& l, const State& state,
                              std::span<const Block> blocks) {
  std::map<std::string, std::vector<double>> cache;
  Eigen::Index width = 0;
  for (const Block& block : blocks)
    width += static_cast<Eigen::Index>(block.terms.parameters.size());
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(l.equations(), width);
  Eigen::Index at = 0;
  for (const Block& block : blocks) {
    for (const Parameter& p : block.terms.parameters) {
      for (const Term& term : p.terms) {
        const std::string key = term.basis.to_string();
        auto found = cache.find(key);
        if (found == cache.end()) {
          found = cache
                      .emplace(key, term.basis.evaluate(
                                        state.rows(),
                                        [&](const std::string& name) -> const std::vector<double>& {
                                          // The predicted point: the noise of the measured one is
                                          // in its residual too, and the two would correlate.
                                          if (name == "x") return l.point[0];
                                          if (name == "y") return l.point[1];
                                          if (name == "z") return l.point[2];
                                          return state.column(name);
                                        }))
                      .first;
        }
        const double* coordinate = l.geometry.col(l.layout.index(term.coordinate)).data();
        double* column = result.col(at).data();
        for (const double basis : found->second) {
          const double value = term.weight * basis;
          for (int h = 0; h < l.height; ++h) *column++ += value * *coordinate++;
        }
      }
      ++at;
    }
  }
  return result;
}

std::vector<EvidenceBlock> evidence_blocks(Fit& fit, const Linearization& linearization,
                                           std::vector<Block> catalogue) {
  return Builder(fit, linearization).candidates(std::move(catalogue));
}

EvidenceModel make_evidence_model(Fit& fit, const Linearization& linearization,
                                  std::vector<EvidenceBlock> blocks) {
  return Builder(fit, linearization).build(std::move(blocks));
}

std::vector<EffectRequest> parts_of(const EffectContext& context, const EffectRequest& entry) {
  const Effect& effect = find_effect(entry.effect);
  EffectRequest whole = entry;
  if (whole.joints.empty()) whole.joints = effect.joints_of_bare_entry(context);
  if (effect.joint_rule() != JointRule::kEach) return {whole};
  std::vector<EffectRequest> result;
  for (const int joint : whole.joints) result.push_back({entry.effect, {joint}, entry.options});
  return result;
}

std::vector<EffectRequest> removable_effects(const Fit& fit) {
  std::vector<EffectRequest> result;
  for (const EffectRequest& entry : fit.specification().effects) {
    if (is_geometry(entry.effect)) continue;
    // The search removes only what it can also propose: candidates of the catalogue and spectral
    // lines. A user's own terms and the grid stay.
    const Effect& effect = find_effect(entry.effect);
    if (effect.tried(fit.context()).empty() && !effect.as_line(fit.context(), 1, 1.0)) continue;
    for (EffectRequest& part : parts_of(fit.context(), entry)) result.push_back(std::move(part));
  }
  return result;
}

}  // namespace armtrue
