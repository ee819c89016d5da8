// The catalogue of physical effects. An effect is one file in this folder: it registers itself,
// states what it needs, and gives its terms; no other code refers to it by name.
#pragma once

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fitter/model/robot.h"
#include "fitter/model/state.h"
#include "fitter/model/term.h"

namespace armtrue {

/// Weak priors on geometry, one standard deviation; stated in every fit and changeable in
/// model.yaml.
struct GeometryPriors {
  double angle = 0.3 * 0.017453292519943295;  ///< [rad]
  double length = 2e-3;                       ///< [m]
};

/// Prior probability that a file counts directions of motion with the opposite sign, so that a lag
/// behind the drive looks like a lead.
inline constexpr double kCountedOtherwise = 0.05;

/// EffectTraits::relative_odds of what data sheets state and hardly any arm is exactly: masses, and
/// a level base. Ours: 4 makes the odds 0.12.
inline constexpr double kOnMostArms = 4.0;

/// A spring that a fit has found: where it yields, to which load, and by how much: compliance ·
/// yields per unit of additional load.
struct Spring {
  Coordinate coordinate;
  std::string load;                             ///< state variable: a torque or a moment of gravity
  double compliance = 0.0;                      ///< [rad/Nm], or the coefficient of the basis
  Expression yields = Expression::number(1.0);  ///< function of the load, if the spring hardens
};

/// What an effect may read when it builds its terms.
struct EffectContext {
  const State& state;
  int targets = 1;
  std::vector<bool> turned_targets{};  ///< by target: its orientation was measured
  GeometryPriors priors{};
  /// Of the fit that this context belongs to, or of the previous one.
  std::vector<Spring> springs{};
  /// By load (state variable): the fitted terms of the effects that carry it, in their coordinate's
  /// unit.
  std::map<std::string, Expression> carried{};
  /// Position of the instrument in the measuring frame [m], and axes of the robot base there.
  Eigen::Vector3d instrument = Eigen::Vector3d::Zero();
  Eigen::Matrix3d measuring_from_base = Eigen::Matrix3d::Identity();

  const Robot& robot() const { return state.robot(); }
  int joint_count() const { return robot().joint_count(); }
  bool has_rotation(int target) const {
    const auto t = static_cast<std::size_t>(target);
    return t < turned_targets.size() && turned_targets[t];
  }
  bool prismatic(int joint) const {
    return robot().joints[static_cast<std::size_t>(joint - 1)].prismatic;
  }
};

/// A requested effect: an entry of model.yaml, or a candidate of the diagnosis.
struct EffectRequest {
  std::string effect;
  std::vector<int> joints;  ///< 1-based; empty: the effect's default joints
  nlohmann::json options = nlohmann::json::object();
};

/// How an effect names joints.
enum class JointRule {
  kNone,  ///< none
  kEach,  ///< any number, each independent of the others
  kAll,   ///< all of them together, or each independently
  kPair,  ///< driven, driving
  kFixed  ///< only its default (linkage, balancer)
};

/// Which joints of an effect must have a motor: a passive joint (robot.yaml) has no gear, no
/// encoder and no command.
enum class DriveRule {
  kNone,    ///< none: the effect is in links, bearings or bars
  kEach,    ///< every one
  kDriving  ///< of a pair only the driving one
};

struct EffectOption {
  std::string name, type, help;
};

/// The share of a load that an effect carries: all its terms together act against that load.
struct CarriedLoad {
  std::string torque;  ///< state variable of the load
  double largest;      ///< largest total of the effect's terms, in their coordinate's unit
};

/// Kind of cause: decides how the search treats an effect and whether it is exported.
enum class Role {
  kPlacement,    ///< pose of base or tool: any value, folded into their frames
  kGeometry,     ///< nominal dimensions of the arm: always in a model, never a finding
  kPhysical,     ///< a cause with a physical bound
  kTable,        ///< fits any cause; preferred only if no physical effect fits as well
  kMeasurement,  ///< of the instrument or the session: fitted, never exported
  kCustom        ///< defined by the user
};

/// Joints that an effect can be on, by how they move.
enum class Motion { kAny, kTurning, kSliding };

/// What an effect is, in words and rules. Its constructor hands this to the base class.
struct EffectTraits {
  std::string id, summary;
  std::string bound;  ///< physical bound on size and sign, with its source, as text for users
  Role role = Role::kPhysical;
  JointRule joints = JointRule::kEach;
  DriveRule drives = DriveRule::kNone;
  Motion motion = Motion::kAny;
  std::vector<EffectOption> options{};
  /// Options that tried() steps through but a fit determines by itself: left out when the effect is
  /// added to a model.
  std::vector<std::string> searched{};
  /// Options that distinguish two findings of one effect on one joint, and are part of its label;
  /// the other options are forms of one finding.
  std::vector<std::string> told_apart{};
  std::vector<std::string> columns{};        ///< variables that it reads: "time"
  std::vector<std::string> joint_columns{};  ///< those of each of its joints: "dir" for dir2
  bool by_sensor = false;  ///< reads one temperature: option `sensor`; candidates have each sensor
  /// How many times likelier than other effects it is, as odds, before there are any data.
  double relative_odds = 1.0;
  /// The terms depend on EffectContext::springs: the fit is then repeated until these no longer
  /// change.
  bool reads_springs = false;
  bool reads_carried = false;  ///< the terms depend on EffectContext::carried
};

class Effect {
 public:
  explicit Effect(EffectTraits traits);
  virtual ~Effect() = default;

  const std::string& id() const { return traits_.id; }
  const std::string& summary() const { return traits_.summary; }
  const std::string& bound_text() const { return traits_.bound; }
  Role role() const { return traits_.role; }
  JointRule joint_rule() const { return traits_.joints; }
  DriveRule drive_rule() const { return traits_.drives; }
  const std::vector<EffectOption>& options() const { return traits_.options; }
  const std::vector<std::string>& searched_options() const { return traits_.searched; }
  const std::vector<std::string>& told_apart_by() const { return traits_.told_apart; }
  double relative_odds() const { return traits_.relative_odds; }
  bool reads_springs() const { return traits_.reads_springs; }
  bool reads_carried() const { return traits_.reads_carried; }
  bool generic() const { return role() == Role::kTable; }
  /// False if the effect belongs to the measurement and not to the arm.
  bool exported() const { return role() != Role::kPlacement && role() != Role::kMeasurement; }

  /// Next finer forms of a request with options that held-out error chooses. If the request leaves
  /// them open: only the coarsest form. Otherwise the forms one step finer, none if the data
  /// support no more. Empty for effects without such options.
  virtual std::vector<EffectRequest> refinements(const EffectContext&, const EffectRequest&) const {
    return {};
  }
  /// The request in a finer form; nullopt if there is none, or it needs more nodes than the data
  /// support.
  virtual std::optional<EffectRequest> finer(const EffectContext&, const EffectRequest&) const {
    return std::nullopt;
  }
  /// The load that the effect carries, if any. Terms that add to that load are hardly this effect.
  virtual std::optional<CarriedLoad> carries() const { return std::nullopt; }

  /// Joints of an entry that names none.
  std::vector<int> joints_of_bare_entry(const EffectContext& context) const;
  /// Requests that the diagnosis tries, each independently.
  std::vector<EffectRequest> tried(const EffectContext& context) const;
  /// Columns to record (or keys of robot.yaml to state) before the effect can be used on these
  /// joints; empty: none. Default: what the traits need.
  virtual std::vector<std::string> missing(const EffectContext& context,
                                           const std::vector<int>& joints) const;
  /// A parameter in common words: "axis 2's zero"; its name if there are none.
  virtual std::string describe(const Parameter& parameter) const;
  /// The effect as the cause of a spectral line in a joint's residual, of so many cycles per turn
  /// (per metre for a sliding joint); nullopt if the effect causes no such lines.
  virtual std::optional<EffectRequest> as_line(const EffectContext&, int, double) const {
    return std::nullopt;
  }
  /// Cycles per turn (per metre) of the waves over its joint that a request on one joint stands
  /// for; none if the effect causes no such lines.
  virtual std::vector<double> lines(const EffectContext&, const EffectRequest&) const { return {}; }
  /// Cycles per turn (per metre) of a joint's waves that candidates() already contains.
  virtual std::vector<double> tried_lines(const EffectContext&, int) const { return {}; }
  /// Terms for validated joints.
  virtual EffectTerms build(const EffectContext& context, const EffectRequest& request) const = 0;

  /// Adds a parameter with one term to `terms`; the reference is valid until the next is added.
  Parameter& add(EffectTerms& terms, const std::vector<int>& joints, const std::string& suffix,
                 const std::string& unit, double bound, Coordinate coordinate,
                 const std::string& expression) const;

 protected:
  /// Joints and requests for joints_of_bare_entry() and tried(), which remove those that
  /// drive_rule() does not allow. Default: all joints that move as the traits say, and one request
  /// for each of them.
  virtual std::vector<int> default_joints(const EffectContext& context) const;
  virtual std::vector<EffectRequest> candidates(const EffectContext& context) const;

 private:
  std::vector<int> joints_that_move_so(const EffectContext& context) const;

  EffectTraits traits_;
};

/// All effects, sorted by id.
const std::vector<const Effect*>& effect_catalogue();
/// Throws ModelError that names the most similar id.
const Effect& find_effect(const std::string& id);
/// Checks joints, options and columns, then builds. Throws ModelError in one sentence.
EffectTerms build_effect(const EffectContext& context, const EffectRequest& request);

/// Registers an effect at start-up: `const RegisterEffect<Backlash> registered_backlash;` in its
/// file.
void register_effect(std::unique_ptr<Effect> effect);
template <typename T>
struct RegisterEffect {
  RegisterEffect() { register_effect(std::make_unique<T>()); }
};

// --- helpers for several effects
// ---------------------------------------------------------------------------------

Coordinate motor(int joint);
Coordinate on_link(int joint, int component);
Coordinate on_base(int component);

/// "effect[2,3].suffix"; "effect.suffix" without joints.
std::string parameter_name(const std::string& effect, const std::vector<int>& joints,
                           const std::string& suffix);

/// A parameter with one term.
Parameter single_term(const std::string& effect, const std::vector<int>& joints,
                      const std::string& suffix, const std::string& unit, double bound,
                      Coordinate coordinate, const std::string& expression);

/// The text of option `unknown.option` of a request. If the request leaves it open, `unknown` is
/// added to the terms, and the text is its name.
std::string number_or_unknown(const EffectRequest& request, const NonlinearParameter& unknown,
                              EffectTerms& terms);

/// Joints that gravity loads: 2 and 3 on a six-axis arm; otherwise those with at least a fifth of
/// the largest gravity torque.
std::vector<int> gravity_loaded_joints(const EffectContext& context);
/// False if gravity makes no torque about the joint for any masses: its axis is vertical.
bool carries_gravity(const EffectContext& context, int joint);

/// Whether joints `first` to `last` all turn, about axes that are parallel at any joint angles.
bool are_parallel(const EffectContext& context, int first, int last);

/// Largest magnitude of a state variable over the rows.
double largest_of(const EffectContext& context, const std::string& variable);
/// Mean of a variable over the data; 0 where it is not recorded.
double mean_of(const EffectContext& context, const std::string& variable);
/// Compliance that gives `deflection` under the largest load in the data; at most `most`.
double softest(const EffectContext& context, const std::string& load, double deflection,
               double most);
/// "rad", or "m" if the joint slides; on_motor chooses between two numbers likewise.
std::string motor_unit(const EffectContext& context, int joint);
double on_motor(const EffectContext& context, int joint, double turning, double sliding);

/// Temperature variable of an entry: option `sensor`, or the first sensor.
std::string temperature_variable(const EffectRequest& request);

}  // namespace armtrue
