#include "fitter/effects/effect.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace armtrue {
namespace {

std::vector<std::unique_ptr<Effect>>& storage() {
  static std::vector<std::unique_ptr<Effect>> effects;
  return effects;
}

// Levenshtein distance, for "did you mean".
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row[b.size()];
}

std::string join(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

std::string component_words(int component) {
  const std::string axis(1, "xyz"[component % 3]);
  return (component < 3 ? "shift along " : "turn about ") + axis;
}

// Whether drive_rule() allows a passive joint at this place of a request.
bool may_be_passive(const Effect& effect, std::size_t place) {
  return effect.drive_rule() == DriveRule::kNone ||
         (effect.drive_rule() == DriveRule::kDriving && place % 2 == 0);
}

// The first joint that needs a motor and has none; 0 if there is no such joint.
int first_without_drive(const EffectContext& context, const Effect& effect,
                        const std::vector<int>& joints) {
  for (std::size_t i = 0; i < joints.size(); ++i) {
    if (context.robot().is_passive(joints[i]) && !may_be_passive(effect, i)) return joints[i];
  }
  return 0;
}

// `joints` without those that lack a motor they need; of a pair, both are removed.
std::vector<int> with_drives(const EffectContext& context, const Effect& effect,
                             const std::vector<int>& joints) {
  const std::size_t step = effect.joint_rule() == JointRule::kPair ? 2 : 1;
  std::vector<int> kept;
  for (std::size_t i = 0; i + step <= joints.size(); i += step) {
    const auto first = joints.begin() + static_cast<std::ptrdiff_t>(i);
    const std::vector<int> together(first, first + static_cast<std::ptrdiff_t>(step));
    if (first_without_drive(context, effect, together) == 0)
      kept.insert(kept.end(), together.begin(), together.end());
  }
  return kept;
}

void check_joints(const EffectContext& context, const Effect& effect,
                  const std::vector<int>& joints) {
  for (const int joint : joints) {
    if (joint < 1 || joint > context.joint_count()) {
      throw ModelError("effect " + effect.id() + ": joint " + std::to_string(joint) +
                       " does not exist, expected 1 to " + std::to_string(context.joint_count()));
    }
  }
  if (effect.joint_rule() == JointRule::kNone && !joints.empty()) {
    throw ModelError("effect " + effect.id() +
                     ": found joints, expected none (it acts on the whole arm)");
  }
  if (effect.joint_rule() == JointRule::kPair && (joints.size() % 2 != 0 || joints.empty())) {
    throw ModelError("effect " + effect.id() + ": found " + std::to_string(joints.size()) +
                     " joints, expected pairs of driven, driving");
  }
  if (const int passive = first_without_drive(context, effect, joints); passive != 0) {
    throw ModelError("effect " + effect.id() + ": found joint " + std::to_string(passive) +
                     ", which is passive, expected a joint with a motor");
  }
  if (effect.joint_rule() == JointRule::kFixed && joints != effect.joints_of_bare_entry(context)) {
    throw ModelError("effect " + effect.id() +
                     ": found other joints than those it acts on; leave joints out");
  }
  std::vector<int> sorted = joints;
  std::sort(sorted.begin(), sorted.end());
  if (effect.joint_rule() != JointRule::kPair &&
      std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
    throw ModelError("effect " + effect.id() + ": a joint is named twice");
  }
}

// `dT` is the first sensor of the present file. Its name replaces `dT`, so that the term reads the
// same sensor in any later file.
void name_thermometer(const EffectContext& context, EffectTerms& terms) {
  if (context.state.sensors().empty()) return;
  const std::string first = "dT_" + context.state.sensors().front();
  const std::map<std::string, Expression> names{{"dT", Expression::variable(first)}};
  for (Parameter& p : terms.parameters) {
    for (Term& term : p.terms) term.basis = term.basis.substitute(names);
  }
}

}  // namespace

void register_effect(std::unique_ptr<Effect> effect) { storage().push_back(std::move(effect)); }

const std::vector<const Effect*>& effect_catalogue() {
  static const std::vector<const Effect*> sorted = [] {
    std::vector<const Effect*> effects;
    for (const auto& effect : storage()) effects.push_back(effect.get());
    std::sort(effects.begin(), effects.end(),
              [](const Effect* a, const Effect* b) { return a->id() < b->id(); });
    return effects;
  }();
  return sorted;
}

const Effect& find_effect(const std::string& id) {
  const std::vector<const Effect*>& all = effect_catalogue();
  const auto at =
      std::lower_bound(all.begin(), all.end(), id,
                       [](const Effect* e, const std::string& i) { return e->id() < i; });
  if (at != all.end() && (*at)->id() == id) return **at;
  const Effect* nearest = nullptr;
  std::size_t least = 1000;
  for (const Effect* effect : all) {
    if (const std::size_t distance = edit_distance(effect->id(), id); distance < least) {
      least = distance;
      nearest = effect;
    }
  }
  throw ModelError("effect '" + id + "' is unknown" +
                   (least <= 4 ? ", did you mean '" + nearest->id() + "'?"
                               : ", expected one of the contract's effect ids"));
}

Effect::Effect(EffectTraits traits) : traits_(std::move(traits)) {
  if (traits_.by_sensor)
    traits_.options.push_back({"sensor", "string", "temperature sensor, default the first"});
}

std::string Effect::describe(const Parameter& p) const {
  if (p.terms.empty() || (role() != Role::kPlacement && role() != Role::kGeometry)) return p.name;
  const Coordinate& at = p.terms.front().coordinate;
  const std::string number = std::to_string(at.index + 1);
  switch (at.place) {
    case Place::kMotor:
      return "axis " + number + "'s zero";
    case Place::kBase:
      return "the base's " + component_words(at.component);
    case Place::kTool:
      return "the tool's " + component_words(at.component);
    case Place::kLink:
      return "link " + number + "'s " + component_words(at.component);
  }
  return p.name;
}

std::vector<int> Effect::joints_of_bare_entry(const EffectContext& context) const {
  return with_drives(context, *this, default_joints(context));
}

std::vector<EffectRequest> Effect::tried(const EffectContext& context) const {
  std::vector<EffectRequest> result;
  for (EffectRequest& request : candidates(context)) {
    const bool names_none = request.joints.empty();
    request.joints = with_drives(context, *this, request.joints);
    if (names_none || !request.joints.empty()) result.push_back(std::move(request));
  }
  return result;
}

std::vector<int> Effect::joints_that_move_so(const EffectContext& context) const {
  std::vector<int> joints;
  for (int k = 1; k <= context.joint_count(); ++k) {
    if (traits_.motion == Motion::kAny ||
        context.prismatic(k) == (traits_.motion == Motion::kSliding))
      joints.push_back(k);
  }
  return joints;
}

std::vector<int> Effect::default_joints(const EffectContext& context) const {
  return joint_rule() == JointRule::kNone ? std::vector<int>{} : joints_that_move_so(context);
}

std::vector<std::string> Effect::missing(const EffectContext& context,
                                         const std::vector<int>& joints) const {
  std::vector<std::string> lacking;
  const auto need = [&](const std::string& column) {
    if (!context.state.has(column)) lacking.push_back(column);
  };
  if (traits_.by_sensor && context.state.sensors().empty()) lacking.emplace_back("temp_NAME");
  for (const std::string& column : traits_.columns) need(column);
  if (traits_.motion == Motion::kSliding && joints.empty())
    lacking.emplace_back("a joint that slides");
  for (const int k : joints) {
    const std::string number = std::to_string(k);
    if (traits_.motion == Motion::kSliding && !context.prismatic(k))
      lacking.push_back("joint " + number + " that slides");
    if (traits_.motion == Motion::kTurning && context.prismatic(k))
      lacking.push_back("a revolute joint " + number);
    for (const std::string& stem : traits_.joint_columns) need(stem + number);
  }
  return lacking;
}

std::vector<EffectRequest> Effect::candidates(const EffectContext& context) const {
  std::vector<EffectRequest> requests;
  if (joint_rule() != JointRule::kEach) requests.push_back({id(), default_joints(context)});
  if (joint_rule() == JointRule::kEach || joint_rule() == JointRule::kAll) {
    for (const int joint : joints_that_move_so(context)) requests.push_back({id(), {joint}});
  }
  if (!traits_.by_sensor) return requests;
  std::vector<EffectRequest> result;
  for (const std::string& sensor : context.state.sensors()) {
    for (EffectRequest request : requests) {
      request.options["sensor"] = sensor;
      result.push_back(std::move(request));
    }
  }
  return result;
}

Parameter& Effect::add(EffectTerms& terms, const std::vector<int>& joints,
                       const std::string& suffix, const std::string& unit, double bound,
                       Coordinate coordinate, const std::string& expression) const {
  Parameter& p = terms.parameters.emplace_back(
      single_term(id(), joints, suffix, unit, bound, coordinate, expression));
  p.exported = exported();
  return p;
}

EffectTerms build_effect(const EffectContext& context, const EffectRequest& given) {
  const Effect& effect = find_effect(given.effect);
  EffectRequest request = given;
  if (request.joints.empty()) request.joints = effect.joints_of_bare_entry(context);
  check_joints(context, effect, request.joints);
  const std::vector<EffectOption>& known = effect.options();
  for (const auto& option : request.options.items()) {
    const std::string& key = option.key();
    const bool found = std::any_of(known.begin(), known.end(),
                                   [&](const EffectOption& o) { return o.name == key; });
    if (found) continue;
    std::vector<std::string> names{"effect", "joints"};
    for (const EffectOption& o : known) names.push_back(o.name);
    throw ModelError("effect " + effect.id() + ": key '" + key + "' is unknown, expected one of " +
                     join(names));
  }
  const std::vector<std::string> lacking = effect.missing(context, request.joints);
  if (!lacking.empty()) {
    const bool one = lacking.size() == 1;
    const bool columns = lacking.front().find(' ') == std::string::npos;
    throw ModelError("effect " + effect.id() + ": expected " +
                     (columns ? (one ? "column " : "columns ") : "") + join(lacking) + ", found " +
                     (one ? "none" : "none of these"));
  }
  EffectTerms terms = effect.build(context, request);
  name_thermometer(context, terms);
  return terms;
}

Coordinate motor(int joint) { return {Place::kMotor, joint - 1, 0}; }
Coordinate on_link(int joint, int component) { return {Place::kLink, joint - 1, component}; }
Coordinate on_base(int component) { return {Place::kBase, 0, component}; }

std::string parameter_name(const std::string& effect, const std::vector<int>& joints,
                           const std::string& suffix) {
  std::string name = effect;
  if (!joints.empty()) {
    name += "[";
    for (std::size_t i = 0; i < joints.size(); ++i)
      name += (i ? "," : "") + std::to_string(joints[i]);
    name += "]";
  }
  return suffix.empty() ? name : name + "." + suffix;
}

Parameter single_term(const std::string& effect, const std::vector<int>& joints,
                      const std::string& suffix, const std::string& unit, double bound,
                      Coordinate coordinate, const std::string& expression) {
  Parameter p;
  p.name = parameter_name(effect, joints, suffix);
  p.effect = effect;
  p.joints = joints;
  p.unit = unit;
  p.bound = bound;
  // Three bounds wide: it limits parameters that the data do not determine, without affecting those
  // that they do.
  p.prior_sigma = 3.0 * bound;
  p.terms.push_back(Term{coordinate, Expression::parse(expression)});
  return p;
}

std::string number_or_unknown(const EffectRequest& request, const NonlinearParameter& unknown,
                              EffectTerms& terms) {
  if (request.options.contains(unknown.option))
    return Expression::number(request.options[unknown.option].get<double>()).to_string();
  terms.nonlinear.push_back(unknown);
  return unknown.name;
}

double mean_of(const EffectContext& context, const std::string& variable) {
  if (!context.state.has(variable)) return 0.0;
  const std::vector<double>& values = context.state.column(variable);
  return values.empty() ? 0.0
                        : std::accumulate(values.begin(), values.end(), 0.0) /
                              static_cast<double>(values.size());
}

double largest_of(const EffectContext& context, const std::string& variable) {
  double largest = 0.0;
  for (const double v : context.state.column(variable)) largest = std::max(largest, std::abs(v));
  return largest;
}

double softest(const EffectContext& context, const std::string& load, double deflection,
               double most) {
  const double largest = largest_of(context, load);
  return largest * most > deflection ? deflection / largest : most;
}

std::string motor_unit(const EffectContext& context, int joint) {
  return context.prismatic(joint) ? "m" : "rad";
}

double on_motor(const EffectContext& context, int joint, double turning, double sliding) {
  return context.prismatic(joint) ? sliding : turning;
}

namespace {

// Torque about joint k by a unit mass at each body, root of the sum of squares [Nm/kg].
double gravity_load(const EffectContext& context, int k) {
  double sum = 0.0;
  for (int j = k; j <= context.joint_count(); ++j) {
    for (const double v :
         context.state.column("u_" + std::to_string(k) + "_" + std::to_string(j) + "_m"))
      sum += v * v;
  }
  return std::sqrt(sum);
}

}  // namespace

std::vector<int> gravity_loaded_joints(const EffectContext& context) {
  if (context.joint_count() == 6) return {2, 3};
  std::vector<double> load;
  for (int k = 1; k <= context.joint_count(); ++k) load.push_back(gravity_load(context, k));
  const double largest = *std::max_element(load.begin(), load.end());
  std::vector<int> joints;
  for (std::size_t k = 0; k < load.size(); ++k) {
    if (load[k] > 0.2 * largest && largest > 0.0) joints.push_back(static_cast<int>(k) + 1);
  }
  return joints;
}

bool carries_gravity(const EffectContext& context, int joint) {
  constexpr double kLeastLoad = 0.1;  // [Nm/kg]: a lever of 1 cm, or a nearly vertical axis
  const double load = gravity_load(context, joint);
  return load > kLeastLoad * std::sqrt(static_cast<double>(context.state.rows()));
}

bool are_parallel(const EffectContext& context, int first, int last) {
  for (int k = first; k <= last; ++k) {
    if (context.prismatic(k)) return false;
    const Pose& fixed = context.robot().joints[static_cast<std::size_t>(k - 1)].fixed;
    if (k > first && std::abs(fixed.linear()(2, 2)) < 1.0 - 1e-6) return false;
  }
  return true;
}

std::string temperature_variable(const EffectRequest& request) {
  return request.options.contains("sensor") ? "dT_" + request.options["sensor"].get<std::string>()
                                            : "dT";
}

}  // namespace armtrue
