// The catalogue of physical effects. An effect is one file in this folder: it registers itself,
// says what it needs, and gives its terms; nothing else in the house knows it by name.
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

/// Prior probability that a file counts directions of motion the other way round, so that what lags
/// behind its drive seems to lead.
inline constexpr double kCountedOtherwise = 0.05;

/// A spring that a fit has found: what yields, to which load, and how much: compliance · yields for
/// a unit of load more.
struct Spring {
  Coordinate coordinate;
  std::string load;                             ///< state variable: a torque or a moment of gravity
  double compliance = 0.0;                      ///< [rad/Nm], or its coefficient
  Expression yields = Expression::number(1.0);  ///< of the load, where the spring hardens
};

/// What an effect may look at when it gives its terms.
struct EffectContext {
  const State& state;
  int targets = 1;
  bool has_rotation = false;
  GeometryPriors priors{};
  /// Of the fit that the context belongs to, or of the one before it.
  std::vector<Spring> springs{};
  /// By the load (state variable): what the fit has of effects that carry it, in their coordinate's
  /// unit.
  std::map<std::string, Expression> carried{};
  /// Where the instrument stands in the measuring frame [m], and the robot base's axes there.
  Eigen::Vector3d instrument = Eigen::Vector3d::Zero();
  Eigen::Matrix3d measuring_from_base = Eigen::Matrix3d::Identity();

  const Robot& robot() const { return state.robot(); }
  int joint_count() const { return robot().joint_count(); }
  bool prismatic(int joint) const {
    return robot().joints[static_cast<std::size_t>(joint - 1)].prismatic;
  }
};

/// An effect as asked for: the entry of model.yaml, or a candidate of the diagnosis.
struct EffectRequest {
  std::string effect;
  std::vector<int> joints;  ///< 1-based; empty: the effect's default
  nlohmann::json options = nlohmann::json::object();
};

/// How an effect names joints.
enum class JointRule {
  kNone,  ///< none
  kEach,  ///< any number, each on its own
  kAll,   ///< all of them together, or each on its own
  kPair,  ///< driven, driving
  kFixed  ///< only its default (linkage, balancer)
};

/// Which of the joints that an effect names must have a motor: of a passive joint (robot.yaml)
/// there is no gear, no encoder and no command.
enum class DriveRule {
  kNone,    ///< none: what it describes is in links, bearings or bars
  kEach,    ///< every one
  kDriving  ///< of a pair the driving one
};

struct EffectOption {
  std::string name, type, help;
};

/// What an effect carries of a load, so that all that it gives runs against that load.
struct CarriedLoad {
  std::string torque;  ///< state variable of the load
  double largest;      ///< of what the effect gives in all, in its coordinate's unit
};

/// What kind of cause an effect is: what the search may do with it, and what becomes of it.
enum class Role {
  kPlacement,    ///< where the base stands and the tool sits: any value, folded into their frames
  kGeometry,     ///< the arm's nominal numbers: always in a model, never a finding
  kPhysical,     ///< a cause with a bound that physics gives
  kTable,        ///< fits any cause; preferred only where no physical effect does as well
  kMeasurement,  ///< of the instrument or the session: fitted, never exported
  kCustom        ///< a user's own
};

class Effect {
 public:
  virtual ~Effect() = default;

  virtual std::string id() const = 0;
  virtual std::string summary() const = 0;
  virtual Role role() const { return Role::kPhysical; }
  virtual JointRule joint_rule() const = 0;
  virtual DriveRule drive_rule() const { return DriveRule::kNone; }
  virtual std::vector<EffectOption> options() const { return {}; }
  /// False where it belongs to the measurement and not to the arm.
  bool exported() const { return role() != Role::kPlacement && role() != Role::kMeasurement; }
  /// Physical bound on size and sign, with its source, for people.
  virtual std::string bound_text() const = 0;

  /// Options that tried() steps through and that a fit then finds or chooses by itself: left
  /// out when an effect is added.
  virtual std::vector<std::string> searched_options() const { return {}; }
  /// Options that tell two findings of one effect on one joint apart, and stand in its label;
  /// others are forms of one finding.
  virtual std::vector<std::string> told_apart_by() const { return {}; }
  /// Next finer forms of a request whose options held-out error has to choose: of a request that
  /// leaves them open the coarsest form alone, of a closed one those one step finer, none where the
  /// data carry no more. An effect without such options has none.
  virtual std::vector<EffectRequest> refinements(const EffectContext&, const EffectRequest&) const {
    return {};
  }
  /// The same in a finer form; none where it has none, or more nodes than the data can carry.
  virtual std::optional<EffectRequest> finer(const EffectContext&, const EffectRequest&) const {
    return std::nullopt;
  }
  /// The load that it carries; empty: none. What adds to that load instead is hardly this effect.
  virtual std::optional<CarriedLoad> carries() const { return std::nullopt; }
  bool generic() const { return role() == Role::kTable; }

  /// True where the terms are weighed by EffectContext::springs: the fit then repeats until these
  /// stand.
  virtual bool reads_springs() const { return false; }

  /// Joints of a bare entry.
  std::vector<int> joints_of_bare_entry(const EffectContext& context) const;
  /// Blocks that the diagnosis tries, each on its own.
  std::vector<EffectRequest> tried(const EffectContext& context) const;
  /// Columns to record (or keys of robot.yaml to give) before this effect can be had on these
  /// joints; empty: none.
  virtual std::vector<std::string> missing(const EffectContext& context,
                                           const std::vector<int>& joints) const;
  /// A parameter as people know it: "axis 2's zero"; its name where there is no better word.
  virtual std::string describe(const Parameter& parameter) const;
  /// The effect as it would explain a line of so many cycles a turn (a metre, where the joint
  /// slides) in a joint's residual; none where it is no such cause.
  virtual std::optional<EffectRequest> as_line(const EffectContext&, int, double) const {
    return std::nullopt;
  }
  /// Cycles a turn (a metre) of the waves of a joint that candidates() has already.
  virtual std::vector<double> tried_lines(const EffectContext&, int) const { return {}; }
  /// Terms for validated joints.
  virtual EffectTerms build(const EffectContext& context, const EffectRequest& request) const = 0;

 protected:
  /// What joints_of_bare_entry() and tried() choose from: those that drive_rule() does not allow
  /// are taken out of it. Default: all joints, and a block for each of them.
  virtual std::vector<int> default_joints(const EffectContext& context) const;
  virtual std::vector<EffectRequest> candidates(const EffectContext& context) const;
};

/// All effects, in the contract's order of registration names.
const std::vector<const Effect*>& effect_catalogue();
/// Throws ModelError naming the nearest known id.
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

// --- what several effects build with
// ---------------------------------------------------------------------------------

Coordinate motor(int joint);
Coordinate on_link(int joint, int component);
Coordinate on_base(int component);
extern const char* const kComponentNames[6];

/// "effect[2,3].suffix"; "effect.suffix" without joints.
std::string parameter_name(const std::string& effect, const std::vector<int>& joints,
                           const std::string& suffix);

/// A parameter with one term.
Parameter single_term(const std::string& effect, const std::vector<int>& joints,
                      const std::string& suffix, const std::string& unit, double bound,
                      Coordinate coordinate, const std::string& expression);

/// Nominal lengths of link k (1…n, from frame k to the next joint) and of the base (k = 0), in that
/// frame [m].
Eigen::Vector3d nominal_lengths(const Robot& robot, int link);

/// Joints that gravity loads: 2 and 3 on a six-axis arm; elsewhere those with at least a fifth of
/// the largest gravity torque.
std::vector<int> gravity_loaded_joints(const EffectContext& context);
/// False where gravity has no torque about the joint whatever the arm weighs: its axis is vertical.
bool carries_gravity(const EffectContext& context, int joint);

/// Largest magnitude of a state variable over the rows.
double largest_of(const EffectContext& context, const std::string& variable);
/// Mean of a variable over the data; 0 where it is not recorded.
double mean_of(const EffectContext& context, const std::string& variable);
/// Compliance that gives `deflection` under the largest load in the data, `most` where that load is
/// small.
double softest(const EffectContext& context, const std::string& load, double deflection,
               double most);
/// "rad", or "m" where the joint slides; the same of a number for each.
std::string motor_unit(const EffectContext& context, int joint);
double on_motor(const EffectContext& context, int joint, double turning, double sliding);

/// Temperature variable of an entry: option `sensor`, or the first sensor.
std::string temperature_variable(const EffectRequest& request);

}  // namespace armtrue
