#include <array>
#include <utility>
#include <vector>

#include "fitter/common/dense.h"
#include "fitter/effects/effect.h"
#include "fitter/effects/loads/gravity_regressors.h"

namespace armtrue {
namespace {

class BendingCompliance final : public Effect {
 public:
  BendingCompliance()
      : Effect({.id = "bending_compliance",
                .summary = "link or bearing bends off its axis",
                .bound = "0 to 5e-3 rad under the largest moment in the data, at most 1e-3 rad/Nm "
                         "(2e-4 where nobody knows the moments): ours, half of what a gear may "
                         "yield, for a bearing is stiffer",
                .options = {{"shape", "string",
                             "hinge (default: all of the link turns at its joint, by the whole "
                             "moment there) or beam (it bends along its length)"}}}) {}

  EffectTerms build(const EffectContext& context, const EffectRequest& request) const override {
    const std::string shape = request.options.value("shape", "hinge");
    if (shape != "hinge" && shape != "beam") {
      throw ModelError("effect bending_compliance: found shape '" + shape +
                       "', expected hinge or beam");
    }
    EffectTerms terms;
    for (const int k : request.joints) {
      if (shape == "beam") {
        add_beam(context, k, terms);
      } else {
        add_tilting(context, *this, k, {kLargest, kSoftest, kUnknown}, terms);
      }
    }
    return terms;
  }

  std::vector<EffectRequest> candidates(const EffectContext& context) const override {
    std::vector<EffectRequest> result = Effect::candidates(context);
    for (int k = 1; k <= context.joint_count(); ++k) {
      if (not_a_beam(context, k).empty()) result.push_back({id(), {k}, {{"shape", "beam"}}});
    }
    return result;
  }

 private:
  static constexpr double kLargest = 5e-3;  // [rad]
  static constexpr double kSoftest = 1e-3;  // [rad/Nm]
  static constexpr double kUnknown = 2e-4;  // [rad/Nm] if the moments are unknown
  static constexpr double kShortest = 0.1;  // [m]: a shorter link is a casting and not a beam

  // A moment about each axis of link k, as sums of weighted state variables.
  using Sum = std::vector<std::pair<double, std::string>>;  // weight, expression
  using Moment = std::array<Sum, 3>;

  // Why link k is not a beam; empty if it is one.
  static std::string not_a_beam(const EffectContext& context, int k) {
    if (k == context.joint_count()) return "no joint at its far end";
    if (context.prismatic(k) || context.prismatic(k + 1)) return "a joint that slides";
    if (span_of(context, k).norm() < kShortest) return "less than 0.1 m of length";
    if (!context.state.computes_torque()) return "no mass and com in robot.yaml";
    return "";
  }

  static Eigen::Vector3d span_of(const EffectContext& context, int k) {
    return context.robot().joints[static_cast<std::size_t>(k)].fixed.translation();
  }

  static Eigen::MatrixXd drives_from_joints(const EffectContext& context) {
    const Eigen::MatrixXd of_joints = context.robot().coupling.transpose();
    return least_squares(of_joints, Eigen::MatrixXd::Identity(of_joints.rows(), of_joints.rows()));
  }

  // Moment of gravity at joint k in link k's axes. About the joint's own axis it follows from the
  // drives' torques, which the coupling mixes: tau = couplingᵀ · moment.
  static Moment moment_at(const EffectContext& context, int k) {
    const std::string joint = std::to_string(k);
    Moment m{Sum{{1.0, "gmx" + joint}}, Sum{{1.0, "gmy" + joint}}, Sum{}};
    const Eigen::MatrixXd of_drives = drives_from_joints(context);
    for (int j = 0; j < context.joint_count(); ++j) {
      const double share = of_drives(k - 1, j);
      if (std::abs(share) > 1e-9) m[2].emplace_back(share, "tau" + std::to_string(j + 1));
    }
    return m;
  }

  static void add_sum(const Sum& from, double weight, const std::string& factor, Sum& to) {
    if (std::abs(weight) < 1e-9) return;
    for (const auto& [share, name] : from) to.emplace_back(weight * share, name + factor);
  }

  // Moment of gravity at joint k + 1, in link k's axes.
  static Moment moment_at_end(const EffectContext& context, int k) {
    const Moment own = moment_at(context, k + 1);
    const std::string angle = "th" + std::to_string(k + 1);
    Moment turned;
    add_sum(own[0], 1.0, "*cos(" + angle + ")", turned[0]);
    add_sum(own[1], -1.0, "*sin(" + angle + ")", turned[0]);
    add_sum(own[0], 1.0, "*sin(" + angle + ")", turned[1]);
    add_sum(own[1], 1.0, "*cos(" + angle + ")", turned[1]);
    turned[2] = own[2];
    const Eigen::Matrix3d axes = context.robot().joints[static_cast<std::size_t>(k)].fixed.linear();
    Moment m;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c)
        add_sum(turned[static_cast<std::size_t>(c)], axes(r, c), "",
                m[static_cast<std::size_t>(r)]);
    }
    return m;
  }

  // Moment of the link's own weight at joint k, with its centre at `centre`.
  static Moment moment_of_weight(const EffectContext& context, int k,
                                 const Eigen::Vector3d& centre) {
    const double mass = context.robot().links[static_cast<std::size_t>(k - 1)].mass;
    const std::string joint = std::to_string(k);
    const Eigen::MatrixXd of_drives = drives_from_joints(context);
    Moment m;
    for (int i = 0; i < 3; ++i) {
      const std::string by = "_" + joint + "_" + "xyz"[i];
      add_sum({{1.0, "ux_" + joint + by}}, mass * centre[i], "", m[0]);
      add_sum({{1.0, "uy_" + joint + by}}, mass * centre[i], "", m[1]);
      for (int j = 0; j < k; ++j)
        add_sum({{of_drives(k - 1, j), "u_" + std::to_string(j + 1) + by}}, mass * centre[i], "",
                m[2]);
    }
    return m;
  }

  // By how much a moment turns the end about the bending axis and shifts it, in units of L/EI,
  // L²/EI.
  struct Share {
    const Moment& moment;
    double turns, shifts;
  };
  static void add_bending(int k, const Eigen::Vector3d& axis, const Eigen::Vector3d& span,
                          const std::vector<Share>& shares, Parameter& p) {
    Sum slope, beyond;  // beyond: shift of the end without that by the slope
    for (std::size_t c = 0; c < 3; ++c) {
      const double own = axis[static_cast<Eigen::Index>(c)];
      for (const Share& share : shares) {
        add_sum(share.moment[c], own * share.turns, "", slope);
        add_sum(share.moment[c], own * (share.shifts - share.turns), "", beyond);
      }
    }
    const Eigen::Vector3d sideways = axis.cross(span);
    for (int c = 0; c < 3; ++c) {
      add_terms(on_link(k, 3 + c), slope, axis[c], p);
      add_terms(on_link(k, c), beyond, sideways[c], p);
    }
  }

  // A cantilever of length L and stiffness EI (Euler and Bernoulli; Timoshenko, Strength of
  // Materials I, ch. 5). The load at its end makes a moment that runs from M₀ − m, m being that of
  // its own weight, to M₁: slope (M₀ − m + M₁)/2, deflection (M₀ − m)/3 + M₁/6, in units of L/EI
  // and L²/EI; one parameter L/EI for each plane. Its own weight, of moment w, is spread evenly:
  // slope w/3, deflection w/4; a separate parameter, since links carry motors anywhere.
  void add_beam(const EffectContext& context, int k, EffectTerms& terms) const {
    if (const std::string why = not_a_beam(context, k); !why.empty()) {
      throw ModelError("effect bending_compliance: link " + std::to_string(k) +
                       " as a beam: found " + why + ", expected a link that can bend");
    }
    const Eigen::Vector3d span = span_of(context, k);
    const Eigen::Vector3d along = span.normalized();
    const Eigen::Vector3d own_axis = Eigen::Vector3d::UnitZ() - along.z() * along;
    const Eigen::Vector3d first =
        (own_axis.norm() > 0.5 ? own_axis : along.cross(Eigen::Vector3d::UnitY())).normalized();
    const Eigen::Vector3d second = along.cross(first);
    const Moment root = moment_at(context, k), end = moment_at_end(context, k);
    const Moment weight = moment_of_weight(
        context, k, context.robot().links[static_cast<std::size_t>(k - 1)].com_in_frame);
    const Moment spread = moment_of_weight(context, k, 0.5 * span);
    const auto begin = [&](const std::string& name) -> Parameter& {
      Parameter& p = add(terms, {k}, name, "rad/Nm", kSoftest, on_link(k, 3), "0");
      p.sign = 1;
      p.terms.clear();
      return p;
    };
    double bound = kSoftest;
    for (const auto& [name, axis] : {std::pair{"plane1", first}, std::pair{"plane2", second}}) {
      Parameter& p = begin(name);
      add_bending(k, axis, span,
                  {{root, 1.0 / 2.0, 1.0 / 3.0},
                   {end, 1.0 / 2.0, 1.0 / 6.0},
                   {weight, -1.0 / 2.0, -1.0 / 3.0}},
                  p);
      p.bound = bound = bound_of(context, k, axis, p);
    }
    Parameter& own = begin("own_weight");
    for (const Eigen::Vector3d& axis : {first, second})
      add_bending(k, axis, span, {{spread, 1.0 / 3.0, 1.0 / 4.0}}, own);
    own.bound = std::min(bound, bound_of(context, k, second, own));
  }

  static void add_terms(Coordinate place, const Sum& sum, double weight, Parameter& p) {
    if (std::abs(weight) < 1e-9) return;
    for (const auto& [share, name] : sum)
      p.terms.push_back({place, Expression::parse(name), weight * share});
  }

  // The compliance at which the link turns about `axis` by kLargest.
  static double bound_of(const EffectContext& context, int k, const Eigen::Vector3d& axis,
                         const Parameter& p) {
    std::vector<double> turn(context.state.rows(), 0.0);
    for (const Term& term : p.terms) {
      for (int c = 0; c < 3; ++c) {
        if (!(term.coordinate == on_link(k, 3 + c))) continue;
        const std::vector<double> basis = context.state.values(term.basis);
        for (std::size_t i = 0; i < turn.size(); ++i) turn[i] += axis[c] * term.weight * basis[i];
      }
    }
    const double largest =
        Eigen::Map<Eigen::ArrayXd>(turn.data(), std::ssize(turn)).abs().maxCoeff();
    return largest * kSoftest > kLargest ? kLargest / largest : kSoftest;
  }
};

const RegisterEffect<BendingCompliance> registered_bending_compliance;

}  // namespace
}  // namespace armtrue
