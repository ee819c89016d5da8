#include "fitter/design/stance.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "fitter/testing/arms.h"

namespace armtrue {
namespace {

// A pendulum: 10 kg at 0.5 m, turning about a horizontal axis on a soft spring.
constexpr double kWeightMoment = 10.0 * 9.81 * 0.5;  // [Nm]
constexpr double kSoft = 4e-4;                       // [rad/Nm]: sags by 20 mrad

nlohmann::json description(bool is_weighed) {
  nlohmann::json robot{
      {"name", "pendulum"},
      {"kinematics",
       {{"convention", "mdh"},
        {"joints", {{{"a", 0.0}, {"alpha", 1.5707963267948966}, {"d", 0.0}, {"offset", 0.0}}}}}}};
  if (is_weighed) robot["links"] = {{{"mass", 10.0}, {"com", {0.5, 0.0, 0.0}}}};
  return robot;
}

struct Pendulum {
  Robot robot;
  Model model;
  std::unique_ptr<Kinematics> kinematics;
  State state;

  explicit Pendulum(const State::Columns& columns, const char* basis = "tau1",
                    bool is_weighed = true)
      : robot(Robot::from_json(description(is_weighed))),
        state(robot, columns, Eigen::Vector3d::Zero()) {
    kinematics = std::make_unique<Kinematics>(robot, 1);
    Parameter spring;
    spring.name = "spring";
    spring.value = kSoft;
    spring.terms.push_back({motor(1), Expression::parse(basis), 1.0, std::nullopt});
    model.parameters.push_back(spring);
  }
};

// angle = q + c * tau(angle), tau = -m g l cos(angle), by Newton, not by fixed-point iteration.
double standing_angle(double q) {
  double angle = q;
  for (int step = 0; step < 20; ++step) {
    const double off = angle - q + kSoft * kWeightMoment * std::cos(angle);
    angle -= off / (1.0 - kSoft * kWeightMoment * std::sin(angle));
  }
  return angle;
}

TEST(Stance, SoftSpring_TorqueIsThatOfTheDeflectedAngle) {
  const std::vector<double> q{-1.2, -0.3, 0.0, 0.7, 1.4};
  Pendulum arm({{"q1", q}});
  stand(arm.state, arm.model, *arm.kinematics);
  for (std::size_t i = 0; i < q.size(); ++i) {
    const double torque = -kWeightMoment * std::cos(standing_angle(q[i]));
    EXPECT_NEAR(arm.state.column("tau1")[i], torque, 1e-9 * kWeightMoment);
  }
}

// Unknown mass moments are fitted with the spring. The torque of a unit moment follows the
// deflection of the joints, and not that of the links (`bent`).
TEST(Stance, UnknownMassMoments_FollowJointDeflectionOnly) {
  const std::vector<double> q{-1.2, -0.3, 0.0, 0.7, 1.4};
  Pendulum arm({{"q1", q}}, "u_1_1_x", false);
  arm.model.parameters.front().value = kSoft * 10.0 * 0.5;
  Parameter bent;
  bent.name = "bent";
  bent.value = 0.1;
  bent.terms.push_back(
      {parse_coordinate("link1.rz", 1, 1), Expression::parse("1"), 1.0, std::nullopt});
  arm.model.parameters.push_back(bent);
  stand(arm.state, arm.model, *arm.kinematics);
  for (std::size_t i = 0; i < q.size(); ++i) {
    const double of_a_unit = -9.81 * std::cos(standing_angle(q[i]));
    EXPECT_NEAR(arm.state.column("u_1_1_x")[i], of_a_unit, 1e-8);
  }
}

TEST(Stance, MeasurementEffect_DoesNotMoveTheArm) {
  Pendulum arm({{"q1", {0.4}}});
  const double nominal = arm.state.column("tau1").front();
  arm.model.parameters.front().exported = false;
  stand(arm.state, arm.model, *arm.kinematics);
  EXPECT_DOUBLE_EQ(arm.state.column("tau1").front(), nominal);
}

TEST(Stance, TermsIndependentOfLoads_NeedNoIteration) {
  Pendulum arm({{"q1", {0.4}}}, "q1");
  BasisTable basis(arm.model, arm.state, arm.kinematics->layout());
  EXPECT_EQ(stand(arm.state, basis, arm.model, {kSoft}, *arm.kinematics), 0.0);
}

}  // namespace
}  // namespace armtrue
