#include "fitter/diagnose/advice.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <optional>
#include <set>
#include <stdexcept>

#include "fitter/diagnose/causes/causes.h"
#include "fitter/diagnose/diagnose.h"
#include "fitter/diagnose/line_advice.h"
#include "fitter/evidence/blocks.h"
#include "fitter/evidence/words.h"
#include "fitter/model/variable.h"

namespace armtrue {
namespace {

// Neighbouring poses have similar errors if their residuals differ by less than this share of the
// difference of any two poses (neighbour_ratio).
constexpr double kNeighboursAlike = 0.7;

// Quantities that a candidate's terms read. To separate two candidates, change a quantity that only
// one of them reads.
struct Reads {
  bool load = false, direction = false, temperature = false, time = false;
};

Reads reads_of(const std::vector<Parameter>& parameters, int joints) {
  Reads reads;
  for (const Parameter& p : parameters) {
    for (const Term& term : p.terms) {
      for (const std::string& name : term.basis.variables()) {
        const auto variable = parse_variable(name, joints);
        if (!variable) continue;
        reads.load = reads.load || variable->is_load() || variable->kind == VariableKind::kPayload;
        reads.direction = reads.direction || variable->kind == VariableKind::kDirection;
        reads.temperature = reads.temperature || variable->kind == VariableKind::kTemperature;
        reads.time = reads.time || variable->kind == VariableKind::kTime;
      }
    }
  }
  return reads;
}

std::string how_to_tell(const Candidate& a, const Candidate& b, int joints) {
  const Reads ra = reads_of(a.parameters, joints), rb = reads_of(b.parameters, joints);
  if (ra.load != rb.load)
    return "measure the same poses with another payload: only one of them follows the load";
  if (ra.direction != rb.direction)
    return "reach the same poses from the other side: only one of them follows the direction of "
           "approach";
  if (ra.temperature != rb.temperature)
    return "measure the same poses at another temperature: only one of them follows it";
  if (ra.time != rb.time)
    return "repeat early poses at the end of the session: only one of them follows time";
  return "armtrue plan chooses poses that separate them best";
}

// "joint 2: 8, 16.1, 24 cycles a turn", "joint 1: 20 mm": the highest peaks of a joint's spectrum
// that are no chance, at most three, strongest first.
std::string periods_of(const JointSpectrum& spectrum, std::size_t rows) {
  constexpr double kLowestOfATurn = 2.5, kWorthNaming = 0.01;
  const double kLowest = spectrum.slides ? 2.0 * spectrum.resolution : kLowestOfATurn;
  std::vector<std::pair<double, double>> peaks;
  for (std::size_t i = 1; i + 1 < spectrum.power.size(); ++i) {
    const bool top =
        spectrum.power[i] >= spectrum.power[i - 1] && spectrum.power[i] > spectrum.power[i + 1];
    if (top && spectrum.cycles[i] > kLowest && spectrum.power[i] > kWorthNaming &&
        is_no_chance(spectrum, spectrum.power[i], rows))
      peaks.emplace_back(spectrum.power[i], spectrum.cycles[i]);
  }
  std::sort(peaks.rbegin(), peaks.rend());
  std::string list;
  for (std::size_t k = 0; k < peaks.size() && k < 3; ++k) {
    char number[16];
    const double cycles = peaks[k].second;
    std::snprintf(number, sizeof number, "%.4g", spectrum.slides ? 1e3 / cycles : cycles);
    list += (list.empty() ? "" : ", ") + std::string(number);
  }
  return list.empty() ? ""
                      : "joint " + std::to_string(spectrum.joint) + ": " + list +
                            (spectrum.slides ? " mm" : " cycles a turn");
}

void advise_periods(const Diagnosis& d, const Candidate& table, std::size_t rows,
                    std::vector<std::string>& advice) {
  std::string all;
  for (const JointSpectrum& spectrum : d.spectra) {
    const auto& joints = table.request.joints;
    if (std::find(joints.begin(), joints.end(), spectrum.joint) == joints.end()) continue;
    const std::string periods = periods_of(spectrum, rows);
    if (!periods.empty()) all += (all.empty() ? "" : "; ") + periods;
  }
  if (!all.empty()) {
    advice.push_back("the joint error in this table is periodic (" + all +
                     "): neither gravity nor low harmonics cause it");
  }
}

// "armtrue add FIT gear_mesh --joints 5 --option 'cycles=[13]' --out FIT2"
std::string command_to_add(const EffectRequest& request) {
  std::string joints, options;
  for (const int k : request.joints)
    joints += (joints.empty() ? " --joints " : ",") + std::to_string(k);
  for (const auto& [name, value] : request.options.items()) {
    const std::string text = value.is_array()    ? list_words(value)
                             : value.is_string() ? value.get<std::string>()
                                                 : value.dump();
    options += " --option '" + name + "=" + text + "'";
  }
  return "armtrue add FIT " + request.effect + joints + options + " --out FIT2";
}

// True if the data settle that `best` is the cause and not `other`: no poses need to be measured
// for that. The figures are those of `armtrue plan` (docs/planning.md, the ambiguity set), not
// refitted.
bool is_settled(const Candidate& best, const Candidate& other) {
  constexpr double kSettled = 10.0;
  return other.delta_bic - best.delta_bic >= kSettled &&
         (find_effect(other.request.effect).generic() ||
          best.score.gain - other.score.gain >= kSettled);
}

// "gear_harmonics 3 or axis_wobble 3: …": which of the two these data prefer, and how to tell them
// apart if that is open.
std::string advise_rival(const Candidate& best, const Candidate& other, int joints) {
  constexpr double kImprobable = 0.05;
  const std::string either = label(best.request) + " or " + label(other.request) + ": ";
  const std::string how = "; " + how_to_tell(best, other, joints);
  const bool settled = is_settled(best, other);
  if (!settled && other.probability >= kImprobable) return either + "the data do not decide" + how;
  std::string text = either + "the data favour the first, but the second explains " +
                     (other.score.explained > best.score.explained ? "more" : "nearly as much");
  if (other.parameters.size() > best.parameters.size()) {
    text += " with " + std::to_string(other.parameters.size()) + " parameters instead of " +
            std::to_string(best.parameters.size());
  }
  return text + (settled ? "" : how);
}

void advise_missing(const Diagnosis& d, const Fit& fit, std::vector<std::string>& advice) {
  const Robot& robot = fit.robot();
  const Candidate& best = *d.recommended();
  advice.push_back("add it: " + command_to_add(best.request));
  std::ranges::move(line_advice(best.request, d.spectra, fit.context()),
                    std::back_inserter(advice));
  if (find_effect(best.request.effect).generic())
    advise_periods(d, best, fit.state().rows(), advice);
  for (const Candidate& other : d.candidates) {
    if (&other == &best) continue;
    const auto& set = best.confounded_with;
    if (std::find(set.begin(), set.end(), label(other.request)) == set.end()) continue;
    const std::string sentence = advise_rival(best, other, robot.joint_count());
    // Forms of one effect have one label.
    if (advice.back() != sentence) advice.push_back(sentence);
    if (advice.size() >= 6) break;
  }
}

bool is_of_first_three(const std::string& variable) {
  return variable == "q1" || variable == "q2" || variable == "q3";
}

// Id of the catalogue's table that acts on single joints (kEach) or on the whole arm (kNone).
std::string table_of(JointRule rule) {
  for (const Effect* effect : effect_catalogue()) {
    if (effect->generic() && effect->joint_rule() == rule) return effect->id();
  }
  throw std::logic_error("the catalogue has no such table");
}

// The command that adds a table; nullopt if the fit already has it.
std::optional<std::string> command_to_add_table(const Fit& fit, EffectRequest table) {
  for (const EffectRequest& entry : fit.specification().effects) {
    for (const EffectRequest& part : parts_of(fit.context(), entry)) {
      if (part.effect == table.effect && part.joints == table.joints) return std::nullopt;
    }
  }
  return command_to_add(table);
}

// The remedy for a structure that no effect of the catalogue explains, by its variables.
std::string remedy(const StructureFinding& f, const Fit& fit) {
  const bool one = f.variables.size() == 1;
  std::optional<std::string> table;
  if (one && f.variables.front().starts_with("q") &&
      f.coordinate == "motor" + f.variables.front().substr(1)) {
    table = command_to_add_table(
        fit, {table_of(JointRule::kEach), {std::stoi(f.variables.front().substr(1))}, {}});
  } else if (std::all_of(f.variables.begin(), f.variables.end(), is_of_first_three)) {
    table = command_to_add_table(fit, {table_of(JointRule::kNone), {}, {}});
  }
  if (table) return *table;
  std::string expressions;
  if (f.has_own_form) {
    for (const Parameter& p : f.block.terms.parameters)
      expressions += (expressions.empty() ? "" : ", ") + p.terms.front().basis.to_string();
  } else if (one) {
    const std::string& v = f.variables.front();
    expressions = v.starts_with("dir") ? v : v + ", " + v + "^2, " + v + "^3";
  } else {
    expressions = f.variables[0] + "*" + f.variables[1];
  }
  return "custom effects in model.yaml on coordinate " + f.coordinate + " with the expression" +
         (expressions.find(',') == std::string::npos ? " " : "s ") + expressions;
}

bool depends_on_posture(const StructureFinding& f, int joints) {
  return std::ranges::any_of(f.variables, [&](const std::string& name) {
    const auto variable = parse_variable(name, joints);
    return variable && variable->is_of_posture();
  });
}

// Advises to record the direction of approach of a joint if most of the error lies along that
// joint's motion and the direction is not recorded; false otherwise. Backlash makes repeats of a
// pose differ, or at least neighbouring poses.
bool advise_direction(const Diagnosis& d, const Fit& fit, std::vector<std::string>& advice) {
  constexpr double kSurely = -6.0, kMostly = 0.5;
  const JointScatter& s = d.scatter;
  if (s.joint == 0 || s.log10_p > kSurely || s.share < kMostly) return false;
  const bool may_be = s.between_repeats || (d.verdict == Verdict::kUnexplainedStructure &&
                                            d.neighbour_ratio >= kNeighboursAlike);
  if (!may_be) return false;
  // The residual depends on a recorded variable other than posture: not an effect of direction.
  if (!s.between_repeats && !d.unexplained().empty() &&
      !depends_on_posture(d.unexplained().front(), fit.robot().joint_count()))
    return false;
  const std::string column = "dir" + std::to_string(s.joint);
  if (fit.state().recorded(column)) return false;
  const std::string unrecorded_payload =
      fit.state().recorded("payload") ? "" : "; if the payload changed, record that too";
  advice.push_back(
      (s.between_repeats ? "repeats of one pose differ" : "the remaining error lies") +
      std::string(" mostly along the motion of joint ") + std::to_string(s.joint) + " (" +
      number_words(std::round(100.0 * s.share)) + " %), as backlash does: record " + column +
      ", the direction of approach, and approach poses from both sides (if the arm moved directly "
      "from row to row, `derive: {dir: from_order}` in a dataset.yaml derives it)" +
      unrecorded_payload);
  return true;
}

// True for a finding of find_motion: an error that follows an unrecorded direction of approach.
bool is_motion(const StructureFinding& f) {
  return f.has_own_form && f.variables.front().starts_with("dir");
}

bool is_step(const StructureFinding& f) { return f.shape.starts_with("a step"); }

// True for a finding of find_knock on joints: they deflect under a changed load.
bool is_load(const StructureFinding& f) {
  return f.has_own_form && is_step(f) && f.coordinate.starts_with("motor");
}

bool goes_with_time(const StructureFinding& f) {
  return std::ranges::find(f.variables, "time") != f.variables.end();
}

// The likely cause of a step in time, and what to do.
std::string event_of_step(const StructureFinding& f, const Fit& fit) {
  if (is_load(f)) {
    return "probable cause: a load was put on the tool or taken off; record it in a column payload "
           "[kg]";
  }
  if (f.tried > 0) {
    return "probable cause: the tracker was moved or set up anew in the pause; number the poses "
           "before and after it 1 and 2 in a column station, and add that effect (a drift over all "
           "sessions fits nearly as well)";
  }
  if (f.coordinate.starts_with("base")) {
    return "probable cause: the tracker or a nest was knocked; number the poses before and after "
           "it 1 and 2 in a column station (or nest), and add that effect";
  }
  const bool at_flange =
      f.coordinate.starts_with("link" + std::to_string(fit.robot().joint_count()) + ".t");
  if (f.coordinate.starts_with("tool.") || at_flange) {
    return "probable cause: a reflector was taken out and put back, or was loose; number the poses "
           "before and after it 1 and 2 in a column nest, and add that effect";
  }
  if (f.coordinate.starts_with("tool[")) {
    return "probable cause: this reflector was taken out and put back, or was loose; give it "
           "another name in the column target from then on";
  }
  if (f.coordinate.starts_with("link")) {
    return "probable cause: a part of the arm moved (a collision, a loose screw); fit only the "
           "poses after it, which describe the present arm";
  }
  return "probable cause: a joint's zero moved (a new mastering, a belt that jumped a tooth); fit "
         "only the poses after it, which describe the present arm";
}

// The likely cause that a finding's form indicates, and what to do; empty if it indicates none.
std::string event_of(const StructureFinding& f, const Fit& fit) {
  if (is_motion(f)) {
    return "probable cause: backlash; `derive: {dir: from_order}` in a dataset.yaml derives "
           "directions from the order of the rows; if the arm did not move directly from row "
           "to row, record " +
           f.variables.front();
  }
  if (f.nodes > 0) {  // set by find_swings only
    return "probable cause: periodic motion of base or instrument (air conditioning, sunlight, the "
           "tracker's stand); shield them, or measure a reflector on the floor between poses";
  }
  if (f.variables != std::vector<std::string>{"time"}) return "";
  if (is_step(f)) return event_of_step(f, fit);
  // No function of time is advised: its correction would go on growing after the session.
  return f.coordinate.starts_with("motor")
             ? "probable cause: a joint's zero drifts as it warms; record temperatures "
               "(temp_NAME), so that the drift can be corrected"
             : "probable cause: base or instrument creep; number parts of the session in a column "
               "station, and add that effect, which is fitted and not exported";
}

// True if the arm deflects under loads and no recorded column shows a change of the tool's load.
bool load_is_unrecorded(const Diagnosis& d, const Fit& fit) {
  if (payload_varies(fit.state())) return false;
  const auto reads_load = [&](const std::vector<Parameter>& parameters) {
    return reads_of(parameters, fit.robot().joint_count()).load;
  };
  return fit.state().computes_torque() || reads_load(fit.model().parameters) ||
         std::ranges::any_of(d.candidates,
                             [&](const Candidate& c) { return reads_load(c.parameters); });
}

// True for a finding that an unrecorded change of load could cause: a step in time, or a dependence
// on posture that changes during the session.
bool may_be_load(const StructureFinding& f, int joints) {
  if (f.variables.size() == 1) return goes_with_time(f) && is_step(f);
  return depends_on_posture(f, joints) &&
         std::ranges::any_of(f.variables, [&](const std::string& name) {
           const auto variable = parse_variable(name, joints);
           return variable && variable->is_of_session();
         });
}

// Advises which columns to record so that more effects can be tested.
void advise_columns(const Diagnosis& d, const Fit& fit, std::vector<std::string>& advice) {
  std::set<std::string> columns;
  if (load_is_unrecorded(d, fit)) columns.insert("payload");
  for (const Untestable& u : d.untestable) {
    for (const std::string& need : u.needs) {
      if (need.find(' ') == std::string::npos) columns.insert(need);
    }
  }
  std::string list;
  for (const std::string& c : columns) list += (list.empty() ? "" : ", ") + c;
  if (!list.empty()) advice.push_back("record next: " + list);
}

void advise_structure(const Diagnosis& d, const Fit& fit, std::vector<std::string>& advice) {
  if (!d.unexplained().empty()) {
    const StructureFinding& f = d.unexplained().front();
    std::string what;
    for (const std::string& v : f.variables) what += (what.empty() ? "" : " and ") + v;
    advice.push_back("the remaining error depends on " + what + " and acts as " + f.coordinate +
                     ": " + f.shape);
    const std::string event = event_of(f, fit);
    advice.push_back(!event.empty() ? event
                                    : "no effect of the catalogue has this form; the generic "
                                      "remedy is: " +
                                          remedy(f, fit));
    if (!is_load(f) && may_be_load(f, fit.robot().joint_count()) && load_is_unrecorded(d, fit)) {
      advice.push_back(
          "or the tool's load changed without being recorded: record it in a column payload [kg]");
    }
    if (is_motion(f)) return;
    if (goes_with_time(f)) {
      advise_direction(d, fit, advice);
      return;
    }
    if (d.neighbour_ratio < kNeighboursAlike) {
      advice.push_back(
          "neighbouring poses have similar errors: they are repeatable and can be compensated");
    } else if (d.lack_of_fit.testable && d.lack_of_fit.against == "repeats") {
      advice.push_back(
          d.lack_of_fit.log10_p < -5.0
              ? "repeats of one pose agree: the error is repeatable and can be compensated"
              : "the repeats do not show whether the error is repeatable: repeat more poses");
    } else {
      advice.push_back("it is not known whether the error is repeatable: repeat some poses");
    }
    advise_direction(d, fit, advice);
    return;
  }
  if (d.gross) {
    advice.push_back(gross_words(*d.gross) +
                     ": a local error of the arm, not bumped "
                     "reflectors; measure more poses there, and give joint " +
                     number_words(d.gross->joint) +
                     " a table (transmission_pwl) fine enough for it");
    return;
  }
  if (d.has_structure())
    advice.push_back("the remaining error is larger than the " + d.lack_of_fit.against +
                     " allow and depends on no recorded variable");
  if (d.has_structure() && d.lack_of_fit.against == "repeats") {
    advice.push_back(
        "repeats of one pose agree, and residuals of different poses do not: either the error "
        "varies too fast over the joints for these poses, or the repeats were taken without "
        "leaving the pose and do not show the arm's repeatability: leave the pose between repeats");
  }
  advise_direction(d, fit, advice);
  advise_columns(d, fit, advice);
}

// Advice where nothing to add was found: whether the remaining error is noise, and by which noise
// floor.
void advise_nothing(const Diagnosis& d, const Fit& fit, std::vector<std::string>& advice) {
  constexpr double kWellAbove = 1.5, kFarAbove = 3.0;
  constexpr double kMeanDistance = 1.6;  // mean length of three equal normal errors, in their sigma
  const NoiseFloor& floor = fit.noise_floor();
  const double held_out = fit.held_out_with_history().errors[0].mean;
  if (advise_direction(d, fit, advice)) return;
  const bool in_train = fit.train_error_with_history().mean > kWellAbove * floor.mean;
  const bool in_held_out = held_out > kWellAbove * floor.mean;
  if (floor.source == "none" || floor.source == "targets") {
    // A floor from distances between reflectors is the instrument's alone: the arm's own
    // repeatability moves all reflectors together and does not show in them.
    advice.push_back("nothing to add was found; whether the " + micrometre_words(held_out) +
                     " that remain are noise is not known: repeat some poses" +
                     (floor.source == "none" ? ", or state the instrument's sigma" : ""));
  } else if ((in_train || in_held_out) && d.rounding.size > 0.0) {
    advice.push_back("nothing to add was found, and the " + micrometre_words(held_out) +
                     " that remain are no more than rounding of joint angles to steps of " +
                     d.rounding.words + " causes");
  } else if (in_train) {
    advice.push_back("nothing to add was found, but the error is " + micrometre_words(held_out) +
                     " and repeats of one pose scatter by " + micrometre_words(floor.mean) +
                     ": a condition differs between visits of a pose and is not recorded correctly "
                     "(direction of approach, payload, temperature), or the arm repeats worse than "
                     "these repeats show");
  } else if (in_held_out) {
    advice.push_back(
        "nothing to add was found, but the error on held-out poses is " +
        micrometre_words(held_out) + ", and the noise alone " + micrometre_words(floor.mean) +
        ": these poses do not determine all parameters of the model (overfitting); measure more");
  } else {
    advice.push_back("nothing to add: what is left is noise as far as these data can tell");
  }
  const bool stated = fit.measurements().sigma_source != SigmaSource::kAssumed;
  const double instrument = fit.measurements().typical_sigma / fit.noise_scale();
  if (stated && floor.source == "repeats" && floor.mean > kFarAbove * kMeanDistance * instrument) {
    advice.push_back("repeats of one pose differ by far more than the instrument's sigma of " +
                     micrometre_words(instrument) + ": something changes between them");
  }
}

// Effects that a model keeps although the arm probably lacks them: held-out errors can favour them
// as stand-ins for an error of another form.
void advise_superfluous(const Diagnosis& d, std::vector<std::string>& advice) {
  std::string list;
  for (const Superfluous& s : d.superfluous) {
    list += (list.empty() ? "" : ", ") + label(s.request) + " (probability " +
            number_words(std::round(100.0 * s.probability)) + " %)";
  }
  if (!list.empty())
    advice.push_back("in the fit, but probably not in the arm: " + list +
                     "; keep it only if held-out errors are larger without it");
}

}  // namespace

std::vector<std::string> advise(const Diagnosis& d, const Fit& fit,
                                const Linearization& linearization) {
  std::vector<std::string> advice;
  const Candidate* left_out = d.left_out();
  if (left_out && !d.recommended()) {
    advice.push_back(
        label(left_out->request) + " (probability " +
        number_words(std::round(100.0 * left_out->probability)) +
        " %) was fitted and left out, because it does not lower the error on held-out "
        "poses: a wrong column, an effect outside the catalogue or chance may look like it");
  }
  if (d.verdict == Verdict::kMissingEffect) advise_missing(d, fit, advice);
  if (d.verdict == Verdict::kUnexplainedStructure) advise_structure(d, fit, advice);
  if (d.verdict == Verdict::kNothingMissing && !left_out) advise_nothing(d, fit, advice);
  // With unexplained structure, the noise figures contain more than noise.
  if (d.verdict != Verdict::kUnexplainedStructure)
    advice.push_back(words_of(d.noise, linearization, fit.robot()));
  if (d.rounding.size > 0.0) {
    advice.push_back("the file has joint angles in steps of " + d.rounding.words +
                     ", and this rounding alone causes as much scatter: write more digits");
  }
  advise_superfluous(d, advice);
  if (fit.knows_history()) advice.push_back(history_words(fit));
  const std::string tables = sentence_of(d.tables);
  if (!tables.empty()) advice.push_back(tables);
  std::string untestable;
  for (const Untestable& u : d.untestable)
    untestable += (untestable.empty() ? "" : ", ") + u.effect;
  if (!untestable.empty())
    advice.push_back("not testable with the recorded columns: " + untestable);
  return advice;
}

}  // namespace armtrue
