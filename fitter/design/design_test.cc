#include "fitter/design/design.h"

#include <ceres/dynamic_autodiff_cost_function.h>
#include <gtest/gtest.h>

#include "fitter/testing/jacobian_check.h"
#include "fitter/testing/problem.h"
#include "fitter/testing/reference_kinematics.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::ProblemOptions;
using testing::Random;

// The whitened residual of one row for any scalar, written from docs/model.md and not from
// design.cc.
struct ReferenceResidual {
  const Problem& problem;
  const Design& design;
  std::size_t row;

  template <typename T>
  bool operator()(T const* const* parameters, T* residuals) const {
    const T* x = parameters[0];
    const auto& free = design.free_parameters();
    std::vector<T> values(problem.model.parameters.size());
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = T(design.values()[i]);
    for (std::size_t u = 0; u < free.size(); ++u) values[static_cast<std::size_t>(free[u])] = x[u];
    const auto lookup = [&](const std::string& name) -> T {
      for (std::size_t j = 0; j < problem.model.nonlinear.size(); ++j) {
        if (problem.model.nonlinear[j].name == name) return x[free.size() + j];
      }
      return T(problem.state->column(name)[row]);
    };
    const CoordinateLayout layout = problem.kinematics->layout();
    std::vector<T> coordinates(static_cast<std::size_t>(layout.size()), T(0.0));
    for (std::size_t i = 0; i < values.size(); ++i) {
      for (const Term& term : problem.model.parameters[i].terms) {
        coordinates[static_cast<std::size_t>(layout.index(term.coordinate))] +=
            values[i] * term.weight * testing::reference_value<T>(term.basis, lookup);
      }
    }
    const Measurements& m = problem.measurements;
    const int target = m.target[row];
    const testing::Matrix4<T> pose = testing::reference_pose<T>(
        problem.robot, problem.kinematics->base(), problem.kinematics->tool(target), layout,
        &problem.state->joints()[row * static_cast<std::size_t>(layout.joints)], coordinates,
        target);
    const double root = std::sqrt(design.weights()[row]);
    for (int r = 0; r < 3; ++r) {
      residuals[r] = T(0.0);
      for (int c = 0; c < 3; ++c) {
        residuals[r] += root * m.whiten_position[row](r, c) *
                        (pose(c, 3) - m.position(c, static_cast<Eigen::Index>(row)));
      }
    }
    if (!m.has_rotation()) return true;
    const Eigen::Matrix<T, 3, 3> turned =
        pose.template topLeftCorner<3, 3>() * m.rotation[row].transpose().cast<T>();
    T log[3];
    ceres::RotationMatrixToAngleAxis(turned.data(), log);
    for (int r = 0; r < 3; ++r) residuals[3 + r] = root / m.sigma_rotation * log[r];
    return true;
  }
};

Eigen::MatrixXd automatic_jacobian(const Problem& problem, const Design& design, std::size_t row,
                                   Eigen::VectorXd& residual) {
  const int height = design.residuals_per_row();
  ceres::DynamicAutoDiffCostFunction<ReferenceResidual, 4> function(
      new ReferenceResidual{problem, design, row});
  function.AddParameterBlock(design.unknowns());
  function.SetNumResiduals(height);
  const std::vector<double> x = design.unknown_values();
  const double* blocks[] = {x.data()};
  residual.resize(height);
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian(
      height, design.unknowns());
  double* jacobians[] = {jacobian.data()};
  EXPECT_TRUE(function.Evaluate(blocks, residual.data(), jacobians));
  return jacobian;
}

Eigen::MatrixXd dense_jacobian(Design& design, std::size_t row, Eigen::VectorXd& residual) {
  Design::Row r;
  design.evaluate(row, true, r);
  const int height = design.residuals_per_row();
  Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(height, design.unknowns());
  for (std::size_t u = 0; u < r.unknowns.size(); ++u) {
    jacobian.col(r.unknowns[u]) = r.jacobian.col(static_cast<Eigen::Index>(u)).head(height);
  }
  residual = r.residual.head(height);
  return jacobian;
}

json effects(std::initializer_list<json> more) {
  json model = testing::geometry_model();
  for (const json& entry : more) model["effects"].push_back(entry);
  return model;
}

struct Named {
  std::string name;
  json robot, model;
  ProblemOptions options;
};

std::vector<Named> problems() {
  Random random(20260202);
  std::vector<Named> result;

  json heavy = testing::industrial_arm();
  testing::add_links(random, heavy);
  heavy["linkage"] = {
      {"type", "parallelogram"}, {"joints", {2, 3}}, {"crank", 0.3}, {"rod", 0.7}, {"angle", 1.6}};
  heavy["coupling"] = {{{"joint", 3}, {"driving", 2}, {"ratio", -1.0}}};
  heavy["kinematics"]["joints"][1]["limits"] = {-0.8, 0.8};
  heavy["kinematics"]["joints"][2]["limits"] = {-0.8, 0.8};
  const json everything = effects({"joint_scale",
                                   "joint_compliance",
                                   "stiffness_nonlinear",
                                   "bending_compliance",
                                   "base_compliance",
                                   "gravity_balancer",
                                   "balancer_state",
                                   "gear_harmonics",
                                   {{"effect", "gear_mesh"}, {"joints", {1, 3}}, {"find", true}},
                                   {{"effect", "transmission_pwl"}, {"joints", {2, 5}}},
                                   "backlash",
                                   "joint_coupling",
                                   "parallelogram",
                                   "thermal_expansion",
                                   "thermal_joint_drift",
                                   "thermal_base",
                                   "warm_up",
                                   "time_drift",
                                   "command_readback",
                                   {{"effect", "residual_grid"}, {"nodes", {3, 3, 3}}},
                                   {{"effect", "custom"},
                                    {"name", "wave"},
                                    {"coordinate", "link4.ry"},
                                    {"expression", "exp(-w*q4^2)*tanh(q5*q6)"},
                                    {"parameters", {{"w", 0.3}}},
                                    {"bound", 1e-3}}});
  result.push_back({"everything at once, with orientations", heavy, everything, {40, true, 1}});

  json slides = testing::random_chain(random, 5, {1, 3});
  slides["coupling"] = {{{"joint", 4}, {"driving", 5}, {"ratio", 0.03}}};
  testing::add_links(random, slides);
  result.push_back({"sliding joints, coupled",
                    slides,
                    effects({"joint_scale", "joint_compliance", "bending_compliance",
                             "gear_harmonics", "backlash"}),
                    {30, true, 2}});

  Instrument tracker;
  tracker.position = {3.0, 1.0, 0.5};
  tracker.radial_a = 5e-6;
  tracker.radial_b = 1e-6;
  tracker.angular_a = 1e-5;
  tracker.angular_b = 4e-6;
  result.push_back({"seven axes, no masses, three reflectors, an instrument's ellipsoids",
                    testing::random_chain(random, 7),
                    effects({"joint_compliance",
                             {{"effect", "bending_compliance"}, {"joints", {2}}},
                             "base_compliance"}),
                    {30, false, 3, 0.0, 0.0, tracker}});
  return result;
}

// A design at typical parameter values; row 1 has a lower weight.
struct PreparedDesign {
  Problem problem;
  Design design;

  PreparedDesign(const Named& named, Random& random)
      : problem(
            named.robot, named.model, named.options, random,
            [&](const Parameter& p) { return testing::normal(random, testing::typical_size(p)); }),
        design(problem.make_design()) {
    std::vector<double> x = design.unknown_values();
    for (std::size_t u = 0; u < design.free_parameters().size(); ++u) {
      const Parameter& p =
          problem.model.parameters[static_cast<std::size_t>(design.free_parameters()[u])];
      x[u] = testing::normal(random, testing::typical_size(p));
    }
    design.set_unknowns(x.data());
    design.weights()[1] = 0.3;
  }
};

TEST(Design, JacobianMatchesAutomaticDifferentiation) {
  Random random(1);
  for (const Named& named : problems()) {
    PreparedDesign p(named, random);
    for (std::size_t row = 0; row < 6; ++row) {
      Eigen::VectorXd analytic_residual, automatic_residual;
      const Eigen::MatrixXd analytic = dense_jacobian(p.design, row, analytic_residual);
      const Eigen::MatrixXd automatic =
          automatic_jacobian(p.problem, p.design, row, automatic_residual);
      EXPECT_LT((analytic_residual - automatic_residual).norm(), 1e-9 * automatic_residual.norm())
          << named.name;
      const auto difference = testing::compare_jacobians(analytic, automatic);
      EXPECT_LT(difference.worst, 1e-9)
          << named.name << ", row " << row << ": " << difference.text();
    }
  }
}

// Typical sizes of all unknowns, as steps.
Eigen::VectorXd sizes_of_unknowns(const PreparedDesign& p) {
  Eigen::VectorXd size(p.design.unknowns());
  const auto linear = static_cast<Eigen::Index>(p.design.free_parameters().size());
  for (Eigen::Index u = 0; u < size.size(); ++u) {
    if (u < linear) {
      const int index = p.design.free_parameters()[static_cast<std::size_t>(u)];
      size[u] = testing::typical_size(p.problem.model.parameters[static_cast<std::size_t>(index)]);
    } else {
      const NonlinearParameter& n = p.problem.model.nonlinear[static_cast<std::size_t>(u - linear)];
      size[u] = 1e-2 * (n.upper - n.lower);
    }
  }
  return size;
}

// Compares the Jacobian of a row with central differences. `stands`: the loads are recomputed at
// each point.
testing::JacobianDifference from_differences(PreparedDesign& p, std::size_t row, bool stands) {
  const std::vector<double> start = p.design.unknown_values();
  const Eigen::VectorXd x =
      Eigen::Map<const Eigen::VectorXd>(start.data(), static_cast<Eigen::Index>(start.size()));
  const auto move_to = [&](const Eigen::VectorXd& at) {
    p.design.set_unknowns(at.data());
    if (stands) p.design.stand(*p.problem.state);
  };
  const auto residual = [&](const Eigen::VectorXd& at) -> Eigen::VectorXd {
    move_to(at);
    Design::Row r;
    p.design.evaluate(row, false, r);
    return r.residual.head(p.design.residuals_per_row());
  };
  const Eigen::MatrixXd numeric =
      testing::numeric_jacobian(residual, x, sizes_of_unknowns(p), 1e-2);
  move_to(x);
  Eigen::VectorXd ignored;
  return testing::compare_jacobians(dense_jacobian(p.design, row, ignored), numeric);
}

TEST(Design, JacobianMatchesCentralDifferences) {
  Random random(2);
  for (const Named& named : problems()) {
    PreparedDesign p(named, random);
    for (std::size_t row = 0; row < 3; ++row) {
      const auto difference = from_differences(p, row, false);
      EXPECT_LT(difference.worst, 1e-4)
          << named.name << ", row " << row << ": " << difference.text();
    }
  }
}

// Friction of a balancer is a share of the balancer's torque, whose coefficients are unknowns too.
TEST(Design, TermsThatFollowACarriedLoad_JacobianIsOfTheProduct) {
  Random random(7);
  PreparedDesign p({"a balancer with friction",
                    testing::industrial_arm(),
                    effects({"gravity_balancer", "balancer_state"}),
                    {}},
                   random);
  p.design.stand(*p.problem.state);
  double most = 0.0;
  for (std::size_t row = 0; row < 6; ++row) {
    const auto difference = from_differences(p, row, false);
    EXPECT_LT(difference.worst, 1e-4) << "row " << row << ": " << difference.text();
    Design::Row now;
    p.design.evaluate(row, false, now);
    most = std::max(most, (now.predicted.matrix() -
                           predict_poses(*p.problem.state, p.problem.measurements.target,
                                         p.problem.model, *p.problem.kinematics)[row]
                               .matrix())
                              .norm());
  }
  EXPECT_GT(most, 1e-6) << "the terms keep the load of their basis";
}

// Loads change with the deflection that they cause. The Jacobian contains this to first order, and
// so does an evaluation before the loads are recomputed.
TEST(Design, StandingArm_JacobianFollowsTheLoads) {
  Random random(6);
  json heavy = testing::industrial_arm(), slides = testing::random_chain(random, 5, {1, 3});
  slides["coupling"] = {{{"joint", 4}, {"driving", 5}, {"ratio", 0.03}}};
  for (json* robot : {&heavy, &slides}) testing::add_links(random, *robot);
  const json compliance{{"effect", "joint_compliance"}, {"joints", {3, 5}}};
  const json bending{{"effect", "bending_compliance"}, {"joints", {2, 4}}};
  const json gear{{"effect", "stiffness_nonlinear"}, {"joints", {3}}, {"soft", true}};
  for (const Named& named :
       {Named{"six axes", heavy, effects({compliance, gear, bending, "base_compliance"}), {}},
        Named{"sliding joints", slides, effects({compliance, bending, "base_compliance"}), {}}}) {
    PreparedDesign p(named, random);
    const double moved = p.design.stand(*p.problem.state);
    EXPECT_GT(moved, 1e-5) << named.name << ": nothing bends";
    EXPECT_LT(moved, 1e-2) << named.name;
    for (std::size_t row = 0; row < 4; ++row) {
      const auto standing = from_differences(p, row, true);
      EXPECT_LT(standing.worst, 1e-3) << named.name << ", row " << row << ": " << standing.text();
      const auto between = from_differences(p, row, false);
      EXPECT_LT(between.worst, 1e-3) << named.name << ", row " << row << ": " << between.text();
    }
  }
}

// The same check must fail for a slightly wrong fitter: here, axis 3 is displaced by 0.1 mm.
TEST(Design, JacobianCheck_DetectsAxisDisplacedByTenthOfAMm) {
  Random random(3);
  const Named named = problems()[1];
  PreparedDesign p(named, random);
  Eigen::VectorXd ignored;
  const Eigen::MatrixXd automatic = automatic_jacobian(p.problem, p.design, 0, ignored);
  p.problem.robot.joints[2].fixed.translation().x() += 1e-4;
  const auto difference =
      testing::compare_jacobians(dense_jacobian(p.design, 0, ignored), automatic);
  EXPECT_GT(difference.worst, 1e-6);
}

TEST(Design, HeldParametersKeepTheirValueAndHaveNoColumn) {
  Random random(4);
  PreparedDesign p(problems()[1], random);
  const std::vector<double> before = p.design.values();
  p.design.set_free({1, 4, 9});
  EXPECT_EQ(p.design.unknowns(), 3);
  EXPECT_EQ(p.design.unknown_of(4), 1);
  EXPECT_EQ(p.design.unknown_of(0), -1);
  const std::vector<double> x{1e-3, 2e-3, 3e-3};
  p.design.set_unknowns(x.data());
  EXPECT_EQ(p.design.values()[9], 3e-3);
  EXPECT_EQ(p.design.values()[0], before[0]);
  Design::Row row;
  p.design.evaluate(0, true, row);
  EXPECT_LE(row.unknowns.size(), 3u);
}

TEST(Design, FixedParametersAreNeverFree) {
  Random random(5);
  PreparedDesign p(problems()[1], random);
  p.problem.model.parameters[2].fixed = true;
  p.design.set_free({0, 1, 2});
  EXPECT_EQ(p.design.unknowns(), 2);
  EXPECT_EQ(p.design.unknown_of(2), -1);
}

TEST(Design, PredictPosesMatchesDesignPredict) {
  Random random(6);
  for (const Named& named : problems()) {
    PreparedDesign p(named, random);
    Model model = p.problem.model;
    for (std::size_t i = 0; i < model.parameters.size(); ++i)
      model.parameters[i].value = p.design.values()[i];
    const std::vector<Pose> poses = predict_poses(*p.problem.state, p.problem.measurements.target,
                                                  model, *p.problem.kinematics);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      EXPECT_LT((poses[i].matrix() - p.design.predict(i).matrix()).norm(), 1e-14) << named.name;
    }
  }
}

TEST(BasisTable, NonFiniteTermValue_ThrowsModelError) {
  Random random(7);
  const json model = effects({{{"effect", "custom"},
                               {"name", "pole"},
                               {"coordinate", "motor2"},
                               {"expression", "1/(q2 - q2)"},
                               {"bound", 1.0}}});
  EXPECT_THROW(Problem(testing::industrial_arm(), model, {10, false, 1}, random,
                       [](const Parameter&) { return 0.0; }),
               ModelError);
}

TEST(Specification, InvalidJointNumber_ThrowsModelError) {
  for (const nlohmann::json& joint :
       {nlohmann::json(1e38), nlohmann::json(-1e38), nlohmann::json(2.5), nlohmann::json(0)}) {
    EXPECT_THROW(ModelSpecification::from_json(
                     {{"effects", {{{"effect", "joint_scale"}, {"joints", {joint}}}}}}),
                 ModelError)
        << joint;
    nlohmann::json robot = testing::industrial_arm();
    robot["coupling"] = {{{"joint", joint}, {"driving", 1}, {"ratio", -1.0}}};
    EXPECT_THROW(Robot::from_json(robot), ModelError) << joint;
  }
}

}  // namespace
}  // namespace armtrue
