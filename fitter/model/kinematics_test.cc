#include "fitter/model/kinematics.h"

#include <gtest/gtest.h>

#include "fitter/testing/arms.h"
#include "fitter/testing/jacobian_check.h"
#include "fitter/testing/reference_kinematics.h"

namespace armtrue {
namespace {

using testing::Random;
using Jacobian6 = Eigen::Matrix<double, 6, Eigen::Dynamic>;
constexpr int kStride = 4;
using Jet = ceres::Jet<double, kStride>;

// A chain at one pose, with random coordinates of standard deviation `size`, and its reference.
struct Case {
  Robot robot;
  int targets = 1, target = 0;
  std::vector<double> q;
  Eigen::VectorXd coordinates;
  std::vector<Pose> tools;
  Pose base;

  Case(const nlohmann::json& content, int target_count, double size, Random& random)
      : robot(Robot::from_json(content)), targets(target_count), target(target_count - 1) {
    const CoordinateLayout layout{robot.joint_count(), targets};
    coordinates =
        Eigen::VectorXd::NullaryExpr(layout.size(), [&] { return testing::normal(random, size); });
    for (int k = 0; k < robot.joint_count(); ++k) q.push_back(testing::uniform(random, -2.0, 2.0));
    for (int t = 0; t < targets; ++t) tools.push_back(testing::random_tool(random));
    base = testing::random_base(random);
  }

  Kinematics kinematics() const {
    Kinematics chain(robot, targets);
    chain.set_base(base);
    for (int t = 0; t < targets; ++t) chain.set_tool(t, tools[static_cast<std::size_t>(t)]);
    return chain;
  }

  template <typename T>
  testing::Matrix4<T> reference(const std::vector<T>& c) const {
    return testing::reference_pose<T>(robot, base, tools[static_cast<std::size_t>(target)],
                                      {robot.joint_count(), targets}, q.data(), c, target);
  }

  // d(position), d(rotation as a left perturbation) by Ceres' jets, a few coordinates at a time.
  Eigen::MatrixXd automatic_jacobian() const {
    const Eigen::Index size = coordinates.size();
    Eigen::MatrixXd jacobian(6, size);
    for (Eigen::Index first = 0; first < size; first += kStride) {
      std::vector<Jet> c;
      for (Eigen::Index i = 0; i < size; ++i) {
        c.emplace_back(coordinates[i]);
        if (i >= first && i < first + kStride) c.back().v[i - first] = 1.0;
      }
      const testing::Matrix4<Jet> pose = reference(c);
      for (Eigen::Index i = first; i < std::min(size, first + kStride); ++i) {
        Eigen::Matrix3d rotation, change;
        for (int r = 0; r < 3; ++r) {
          jacobian(r, i) = pose(r, 3).v[i - first];
          for (int k = 0; k < 3; ++k) {
            rotation(r, k) = pose(r, k).a;
            change(r, k) = pose(r, k).v[i - first];
          }
        }
        const Eigen::Matrix3d spin = change * rotation.transpose();  // skew: dR Rᵀ
        jacobian.block<3, 1>(3, i) << spin(2, 1), spin(0, 2), spin(1, 0);
      }
    }
    return jacobian;
  }
};

std::vector<Case> cases(double size) {
  Random random(20260101);
  std::vector<Case> result;
  nlohmann::json coupled = testing::random_chain(random, 6);
  coupled["coupling"] = {{{"joint", 3}, {"driving", 2}, {"ratio", -1.0}},
                         {{"joint", 6}, {"driving", 5}, {"ratio", 0.02}}};
  nlohmann::json coupled_slide = testing::random_chain(random, 4, {2});
  coupled_slide["coupling"] = {{{"joint", 3}, {"driving", 4}, {"ratio", 0.05}}};
  nlohmann::json dh = testing::random_chain(random, 6);
  dh["kinematics"]["convention"] = "dh";
  dh["kinematics"]["joints"][0]["a"] = 0.3;
  dh["kinematics"]["joints"][0]["alpha"] = -1.1;
  result.emplace_back(testing::industrial_arm(), 1, size, random);
  result.emplace_back(testing::random_chain(random, 6), 1, size, random);
  result.emplace_back(testing::random_chain(random, 7), 3, size, random);
  result.emplace_back(testing::random_chain(random, 5, {0, 2}), 1, size, random);
  result.emplace_back(testing::random_chain(random, 1), 1, size, random);
  result.emplace_back(coupled, 2, size, random);
  result.emplace_back(coupled_slide, 1, size, random);
  result.emplace_back(dh, 1, size, random);
  return result;
}

// Zero, the size of an arm's errors, and far beyond any error.
class KinematicsAtSize : public ::testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Sizes, KinematicsAtSize, ::testing::Values(0.0, 1e-4, 0.3));

TEST_P(KinematicsAtSize, PoseMatchesTheReference) {
  for (const Case& c : cases(GetParam())) {
    const std::vector<double> coordinates(c.coordinates.data(),
                                          c.coordinates.data() + c.coordinates.size());
    Kinematics chain = c.kinematics();
    const Pose pose = chain.forward(c.q.data(), c.coordinates.data(), c.target);
    EXPECT_LT((pose.matrix() - c.reference(coordinates)).cwiseAbs().maxCoeff(), 1e-12)
        << c.robot.joint_count();
    Jacobian6 ignored;
    EXPECT_EQ(pose.matrix(),
              chain.forward(c.q.data(), c.coordinates.data(), c.target, ignored).matrix());
  }
}

TEST_P(KinematicsAtSize, JacobianMatchesAutomaticDifferentiation) {
  for (const Case& c : cases(GetParam())) {
    Kinematics chain = c.kinematics();
    Jacobian6 analytic;
    chain.forward(c.q.data(), c.coordinates.data(), c.target, analytic);
    const auto difference = testing::compare_jacobians(analytic, c.automatic_jacobian());
    EXPECT_LT(difference.worst, 1e-9) << difference.text();
  }
}

TEST_P(KinematicsAtSize, JacobianMatchesCentralDifferences) {
  for (const Case& c : cases(GetParam())) {
    Kinematics chain = c.kinematics();
    Jacobian6 analytic;
    const Pose here = chain.forward(c.q.data(), c.coordinates.data(), c.target, analytic);
    const auto moved = [&](const Eigen::VectorXd& x) -> Eigen::VectorXd {
      const Pose pose = chain.forward(c.q.data(), x.data(), c.target);
      Eigen::VectorXd twist(6);
      twist << pose.translation(), rotation_log(pose.linear() * here.linear().transpose());
      return twist;
    };
    const Eigen::MatrixXd numeric = testing::numeric_jacobian(
        moved, c.coordinates, Eigen::VectorXd::Ones(c.coordinates.size()));
    const auto difference = testing::compare_jacobians(analytic, numeric);
    EXPECT_LT(difference.worst, 1e-4) << difference.text();
  }
}

// The check must detect likely mistakes: axes of a virtual joint not turned by its own rotation, a
// coupling left out, one entry off by 1e-7.
TEST(KinematicsCheck, DetectsSlightlyWrongJacobians) {
  const Case c = cases(0.01)[5];
  Kinematics chain = c.kinematics();
  Jacobian6 right;
  chain.forward(c.q.data(), c.coordinates.data(), c.target, right);
  const Eigen::MatrixXd automatic = c.automatic_jacobian();
  ASSERT_LT(testing::compare_jacobians(right, automatic).worst, 1e-9);

  Eigen::MatrixXd no_left_jacobian =
      right;  // axes of the virtual joint not turned by its own rotation
  const int rx = chain.layout().link(2, 3);
  no_left_jacobian.col(rx) += 0.5 * c.coordinates[rx + 1] * right.col(rx + 2);
  EXPECT_GT(testing::compare_jacobians(no_left_jacobian, automatic).worst, 1e-4);

  Eigen::MatrixXd no_coupling = right;  // motor 2 also turns link 3
  no_coupling.col(1) += right.col(2);
  EXPECT_GT(testing::compare_jacobians(no_coupling, automatic).worst, 1e-2);

  Eigen::MatrixXd slightly = right;
  slightly(1, rx) += 1e-7;
  EXPECT_GT(testing::compare_jacobians(slightly, automatic).worst, 1e-9);
}

TEST(Rotation, LogarithmUndoesExponential) {
  Random random(7);
  for (const double size : {0.0, 1e-9, 1e-3, 9e-3, 1.1e-2, 1.0, 3.1}) {
    const Eigen::Vector3d axis = testing::normal3(random, 1.0).normalized();
    const Eigen::Matrix3d rotation = rotation_exp(size * axis);
    EXPECT_LT((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_LT((rotation_log(rotation) - size * axis).norm(), 1e-9) << size;
  }
}

// d exp(r) = [J_l(r) dr]× exp(r), on both sides of the switch to the series.
TEST(Rotation, LeftJacobianIsTheDerivativeOfTheExponential) {
  Random random(8);
  for (const double size : {0.0, 1e-4, 0.00999, 0.01001, 0.5, 2.5}) {
    const Eigen::Vector3d r = size * testing::normal3(random, 1.0).normalized();
    const auto turned = [&](const Eigen::VectorXd& x) -> Eigen::VectorXd {
      return rotation_log(rotation_exp(x) * rotation_exp(r).transpose());
    };
    const Eigen::MatrixXd numeric = testing::numeric_jacobian(turned, r, Eigen::Vector3d::Ones());
    EXPECT_LT(testing::compare_jacobians(left_jacobian(r), numeric).worst, 1e-8) << size;
  }
}

// Craig's convention and the standard one describe the same arm if a and alpha shift by one row.
TEST(Robot, StandardAndModifiedConventionAgree) {
  Random random(9);
  nlohmann::json modified = testing::random_chain(random, 6);
  nlohmann::json standard = modified;
  standard["kinematics"]["convention"] = "dh";
  auto& rows = standard["kinematics"]["joints"];
  for (std::size_t k = 0; k < 6; ++k) {
    const bool last = k == 5;
    rows[k]["a"] = last ? 0.0 : modified["kinematics"]["joints"][k + 1]["a"].get<double>();
    rows[k]["alpha"] = last ? 0.0 : modified["kinematics"]["joints"][k + 1]["alpha"].get<double>();
  }
  const Robot a = Robot::from_json(modified), b = Robot::from_json(standard);
  Kinematics first(a, 1), second(b, 1);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(first.layout().size());
  const std::vector<double> q{0.3, -0.7, 1.1, 0.2, -1.9, 0.8};
  EXPECT_LT((first.forward(q.data(), zero.data(), 0).matrix() -
             second.forward(q.data(), zero.data(), 0).matrix())
                .cwiseAbs()
                .maxCoeff(),
            1e-12);
}

}  // namespace
}  // namespace armtrue
