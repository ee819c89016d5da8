#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "fitter/effects/effect.h"
#include "fitter/testing/arms.h"

namespace armtrue {
namespace {

using testing::Random;

const Eigen::Vector3d kPayloadPoint(0.05, -0.08, 0.12);
constexpr int kLink = 2;  // 1-based

struct Loaded {
  Robot robot;
  State::Columns columns;
  std::unique_ptr<State> state;

  Loaded() {
    Random random(17);
    nlohmann::json content = testing::random_chain(random, 5);
    content["coupling"] = {{{"joint", 3}, {"driving", 2}, {"ratio", -1.0}}};
    content["gravity"] = {0.7, -1.1, -9.7};
    testing::add_links(random, content);
    robot = Robot::from_json(content);
    columns = testing::random_joints(robot, 6, random);
    testing::add_recorded_state(robot, random, columns);
    state = std::make_unique<State>(robot, columns, kPayloadPoint);
  }

  EffectTerms beam() const {
    return build_effect(EffectContext{*state},
                        {"bending_compliance", {kLink}, {{"shape", "beam"}}});
  }

  // Turn and shift of the link at its root by `parameters`, each of value 1.
  std::pair<Eigen::Vector3d, Eigen::Vector3d> moved(const std::vector<Parameter>& parameters,
                                                    std::size_t row) const {
    Eigen::Vector3d turn = Eigen::Vector3d::Zero(), shift = Eigen::Vector3d::Zero();
    for (const Parameter& p : parameters) {
      for (const Term& term : p.terms) {
        const double value =
            term.weight *
            term.basis.evaluate(state->rows(),
                                [&](const std::string& name) -> const std::vector<double>& {
                                  return state->column(name);
                                })[row];
        for (int c = 0; c < 3; ++c) {
          if (term.coordinate == Coordinate{Place::kLink, kLink - 1, 3 + c}) turn[c] += value;
          if (term.coordinate == Coordinate{Place::kLink, kLink - 1, c}) shift[c] += value;
        }
      }
    }
    return {turn, shift};
  }

  // Weights beyond the link or, if `slices` > 0, its own in as many equal parts along it: place and
  // force in its frame.
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> weights(std::size_t row,
                                                                   int slices) const {
    Pose pose = Pose::Identity();
    std::vector<Pose> frames;
    for (int k = 0; k < robot.joint_count(); ++k) {
      const Joint& joint = robot.joints[static_cast<std::size_t>(k)];
      pose = pose * joint.fixed;
      pose.rotate(Eigen::AngleAxisd(state->column("th" + std::to_string(k + 1))[row],
                                    Eigen::Vector3d::UnitZ()));
      frames.push_back(pose);
    }
    const Pose link_from_base = frames[kLink - 1].inverse();
    const Eigen::Vector3d gravity = link_from_base.linear() * robot.gravity;
    std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> result;
    for (int i = 0; i < slices; ++i)
      result.emplace_back((i + 0.5) / slices * span(),
                          robot.links[kLink - 1].mass / slices * gravity);
    if (slices > 0) return result;
    for (std::size_t j = kLink; j < frames.size(); ++j)
      result.emplace_back(link_from_base * (frames[j] * robot.links[j].com_in_frame),
                          robot.links[j].mass * gravity);
    result.emplace_back(link_from_base * (frames.back() * (robot.end * kPayloadPoint)),
                        columns.at("payload")[row] * gravity);
    return result;
  }

  Eigen::Vector3d span() const { return robot.joints[kLink].fixed.translation(); }

  // Slope and deflection of the link's end, from the sum of its curvature, EI = L.
  std::pair<Eigen::Vector3d, Eigen::Vector3d> bent(std::size_t row, int slices) const {
    constexpr int kSteps = 400;
    const auto loads = weights(row, slices);
    const double length = span().norm();
    const Eigen::Vector3d along = span() / length;
    Eigen::Vector3d slope = Eigen::Vector3d::Zero(), deflection = Eigen::Vector3d::Zero();
    for (int i = 0; i < kSteps; ++i) {
      const double at = (i + 0.5) / kSteps * length;
      Eigen::Vector3d moment = Eigen::Vector3d::Zero();
      for (const auto& [place, force] : loads) {
        if (slices > 0 && place.norm() < at) continue;
        moment += (place - at * along).cross(force);
      }
      const Eigen::Vector3d curvature = (moment - moment.dot(along) * along) / length;
      slope += curvature * length / kSteps;
      deflection += curvature.cross(along) * (length - at) * length / kSteps;
    }
    return {slope, deflection};
  }
};

TEST(BendingCompliance, Beam_MatchesTheIntegralOfItsCurvature) {
  const Loaded arm;
  const std::vector<Parameter> all = arm.beam().parameters;
  ASSERT_EQ(all.size(), 3u);
  const std::vector<Parameter> hanging(all.begin(), all.begin() + 2),
      own(all.begin() + 2, all.end());
  for (std::size_t row = 0; row < 6; ++row) {
    for (const auto& [parameters, slices] : {std::pair{hanging, 0}, std::pair{own, 400}}) {
      const auto [turn, shift] = arm.moved(parameters, row);
      const auto [slope, deflection] = arm.bent(row, slices);
      EXPECT_LT((turn - slope).norm(), 2e-3 * slope.norm()) << row << " " << slices;
      EXPECT_LT((shift + turn.cross(arm.span()) - deflection).norm(), 2e-3 * deflection.norm())
          << row << " " << slices;
    }
  }
}

TEST(BendingCompliance, BoundOfABeam_LimitsItsTurnToFiveMrad) {
  const Loaded arm;
  for (const Parameter& p : arm.beam().parameters) {
    double largest = 0.0;
    for (std::size_t row = 0; row < 6; ++row)
      largest = std::max(largest, arm.moved({p}, row).first.norm());
    EXPECT_LE(p.bound * largest, 5e-3 * 1.001) << p.name;
    EXPECT_LE(p.bound, 1e-3);
    EXPECT_EQ(p.sign, 1);
  }
}

TEST(BendingCompliance, UnknownShapeOrUnloadedBeam_IsRefused) {
  const Loaded arm;
  const auto build = [&](int joint, const char* shape) {
    build_effect(EffectContext{*arm.state}, {"bending_compliance", {joint}, {{"shape", shape}}});
  };
  EXPECT_THROW(build(2, "plank"), ModelError);
  EXPECT_THROW(build(5, "beam"), ModelError);  // nothing hangs on its end
  EXPECT_NO_THROW(build(5, "hinge"));
}

}  // namespace
}  // namespace armtrue
