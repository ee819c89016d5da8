#include "fitter/solve/fit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "fitter/solve/prediction.h"
#include "fitter/testing/problem.h"

namespace armtrue {
namespace {

using nlohmann::json;
using testing::Problem;
using testing::ProblemOptions;
using testing::Random;

double field_error(const Parameter& p, Random& random) {
  if (p.effect == "base_frame" || p.effect == "tool_offset") return 0.0;
  return testing::normal(random, p.unit == "m" ? 2e-4 : 5e-4);
}

Problem geometry_problem(std::uint64_t seed,
                         ProblemOptions options = {120, false, 1, 1e-5, 2e-5, {}}) {
  Random random(seed);
  return Problem(testing::industrial_arm(), testing::geometry_model(), options, random,
                 [&](const Parameter& p) { return field_error(p, random); });
}

std::unique_ptr<Fit> fit_of(const Problem& p, const json& model = testing::geometry_model(),
                            const FitOptions& options = {}) {
  return Fit::run(p.robot, p.columns, ModelSpecification::from_json(model), options);
}

TEST(Fit, Geometry_ErrorsReachTheNoise) {
  const Problem p = geometry_problem(51);
  const auto fit = fit_of(p);
  EXPECT_NEAR(fit->train_error().rms, 1e-5 * std::sqrt(3.0), 2.5e-6);
  EXPECT_LT(fit->held_out_error().rms, 2.6e-5);
  EXPECT_GT(fit->held_out_error().rms, fit->train_error().rms);
  EXPECT_TRUE(fit->rejected().empty());
  EXPECT_TRUE(fit->document()["warnings"].empty());
}

TEST(Fit, DataWithoutNoiseAreFittedWithoutError) {
  // The first axis's zero and the base's turn are one number to first order. A base that tilts as
  // it warms makes them two to second order: this must not make the effect unobservable.
  for (const char* effect : {"thermal_base", "time_drift"}) {
    Random random(57);
    json model = testing::geometry_model();
    model["effects"].push_back(effect);
    const Problem p(testing::industrial_arm(), model, {60}, random, [&](const Parameter& q) {
      return q.effect == effect ? testing::normal(random, 0.1 * q.bound) : field_error(q, random);
    });
    const auto fit = fit_of(p, model);
    EXPECT_LT(fit->train_error().max, 1e-7) << effect;
    const json document = fit->document();
    for (const json& sentence : document["unobservable"])
      EXPECT_EQ(sentence.get<std::string>().find(effect), std::string::npos) << sentence;
  }
}

TEST(Fit, UnstatedNoise_IsEstimated) {
  const Problem p = geometry_problem(52, {300, true, 1, 4e-5, 7e-5, {}});
  const auto fit = fit_of(p);
  EXPECT_NEAR(fit->measurements().typical_sigma, 4e-5, 3e-6);
  EXPECT_NEAR(fit->measurements().sigma_rotation, 7e-5, 6e-6);
}

TEST(Fit, BumpedReflectors_AreRejectedAndListed) {
  Problem p = geometry_problem(53);
  const auto clean = fit_of(p);
  const std::set<std::size_t> bumped{4, 5, 31, 77, 78, 79, 118};
  for (const std::size_t row : bumped) p.columns["z"][row] += row % 2 ? 4e-4 : -1.5e-3;
  const auto fit = fit_of(p);
  std::set<std::size_t> found;
  for (const RejectedRow& r : fit->rejected()) {
    found.insert(r.row);
    EXPECT_GT(r.residual, 3e-4);
  }
  EXPECT_EQ(found, bumped);
  EXPECT_EQ(fit->train_error().count, 120 - bumped.size());
  EXPECT_LT(fit->train_error().rms, 1.2 * clean->train_error().rms);
  EXPECT_EQ(fit->document()["rejected"].size(), bumped.size());
}

TEST(Fit, WithoutGrossErrors_NoRowIsRejected) {
  for (std::uint64_t seed = 60; seed < 70; ++seed)
    EXPECT_TRUE(fit_of(geometry_problem(seed))->rejected().empty()) << seed;
}

TEST(Fit, SigmasHoldForRepeatedShotsOfAVisit) {
  // All shots of a visit share the arm's scatter of that visit. The error of a coefficient by noise
  // must be as large as its sigma.
  const std::size_t poses = 60, shots = 5;
  for (const double shared : {0.0, 3e-5}) {
    double squares = 0.0, count = 0.0;
    for (std::uint64_t seed = 80; seed < 92; ++seed) {
      Problem p = geometry_problem(seed, {poses, false, 1, 0.0, 0.0, {}});
      State::Columns once = p.columns;
      for (std::size_t shot = 1; shot < shots; ++shot) {
        for (auto& [name, values] : p.columns)
          values.insert(values.end(), once[name].begin(), once[name].end());
      }
      for (std::size_t row = 0; row < poses * shots; ++row)
        p.columns["repeat"].push_back(static_cast<double>(row % poses));
      const auto exact = fit_of(p);
      Random random(seed);
      for (const char* axis : {"x", "y", "z"}) {
        for (std::size_t pose = 0; pose < poses; ++pose) {
          const double scatter = testing::normal(random, shared);
          for (std::size_t shot = 0; shot < shots; ++shot)
            p.columns[axis][shot * poses + pose] += scatter + testing::normal(random, 1e-5);
        }
      }
      const auto fit = fit_of(p);
      const Eigen::MatrixXd covariance = fit->covariance();
      for (std::size_t i = 0; i < fit->model().parameters.size(); ++i) {
        const Parameter& q = fit->model().parameters[i];
        const int unknown = fit->design().unknown_of(static_cast<int>(i));
        if (unknown < 0 || exact->design().unknown_of(static_cast<int>(i)) < 0) continue;
        if (q.effect == "base_frame" || q.effect == "tool_offset") continue;
        const double pull = (q.value - exact->model().parameters[i].value) /
                            std::sqrt(covariance(unknown, unknown));
        squares += pull * pull;
        count += 1.0;
      }
    }
    EXPECT_NEAR(std::sqrt(squares / count), 1.0, 0.15) << shared;
  }
}

TEST(Fit, SigmasHoldWhereAJointDoesNotRepeat) {
  // The scatter of joint 1 is horizontal. Treated as scatter in all directions, it would make
  // parameters that lift the tool seem less certain than they are.
  double squares = 0.0, count = 0.0;
  for (std::uint64_t seed = 300; seed < 360; ++seed) {
    Problem p = geometry_problem(seed, {120, false, 1, 0.0, 0.0, {}});
    const auto exact = fit_of(p);
    Random random(seed);
    for (double& angle : p.columns["q1"]) angle += testing::normal(random, 6e-5);
    for (const char* axis : {"x", "y", "z"}) {
      for (double& value : p.columns[axis]) value += testing::normal(random, 1e-5);
    }
    const auto fit = fit_of(p);
    const int zero = fit->model().index("joint_offset[2]");
    const int unknown = fit->design().unknown_of(zero);
    ASSERT_GE(unknown, 0);
    const auto at = static_cast<std::size_t>(zero);
    const double pull = (fit->model().parameters[at].value - exact->model().parameters[at].value) /
                        std::sqrt(fit->covariance()(unknown, unknown));
    squares += pull * pull;
    count += 1.0;
  }
  EXPECT_NEAR(std::sqrt(squares / count), 1.0, 0.2);
}

TEST(Fit, WarmStart_ReachesTheSameSolutionInFewerSteps) {
  const Problem p = geometry_problem(58);
  const auto cold = fit_of(p);
  FitOptions options;
  options.start = std::make_shared<StartPoint>(cold->start_point());
  const auto warm = fit_of(p, testing::geometry_model(), options);
  EXPECT_LT(warm->solver_iterations(), cold->solver_iterations());
  EXPECT_NEAR(warm->train_error().rms, cold->train_error().rms, 1e-9);
  for (std::size_t i = 0; i < cold->model().parameters.size(); ++i) {
    EXPECT_NEAR(warm->model().parameters[i].value, cold->model().parameters[i].value, 1e-9)
        << cold->model().parameters[i].name;
  }
  EXPECT_EQ(warm->options().start, nullptr);
}

TEST(Fit, KeptWeightsOfTheStart_MatchAFullFit) {
  const json geometry = testing::geometry_model();
  json tables = geometry, whole = geometry;
  tables["effects"].push_back("transmission_pwl");
  whole["effects"].push_back("transmission_pwl");
  whole["effects"].push_back({{"effect", "joint_scale"}, {"joints", {4}}});
  Random random(58);
  const Problem p(testing::industrial_arm(), whole, {240, true, 1, 1e-5, 2e-5, {}}, random,
                  [&](const Parameter& q) {
                    if (q.effect == "transmission_pwl") return testing::normal(random, 2e-5);
                    return q.effect == "joint_scale" ? 1e-5 : field_error(q, random);
                  });
  const auto start = fit_of(p, tables);
  EXPECT_FALSE(start->kept_weights());
  FitOptions options = start->options();
  options.start = std::make_shared<StartPoint>(start->start_point());
  const auto full = fit_of(p, whole, options);
  options.keeps_weights = true;
  const auto kept = fit_of(p, whole, options);
  EXPECT_TRUE(kept->kept_weights());
  EXPECT_FALSE(full->kept_weights());
  EXPECT_EQ(kept->smoothness_sigma(), start->smoothness_sigma());
  EXPECT_NEAR(kept->held_out_error().mean, full->held_out_error().mean,
              0.02 * full->held_out_error().mean);
  // The fit refines the noise scale from the start's value; a full fit begins at the stated noise,
  // and neither iterates to convergence.
  EXPECT_NEAR(kept->noise_scale(), start->noise_scale(), 0.02 * start->noise_scale());
  // Tables that the start does not contain need their weights determined first.
  options.start = std::make_shared<StartPoint>(fit_of(p, geometry)->start_point());
  EXPECT_FALSE(fit_of(p, whole, options)->kept_weights());
}

// Before, the model lacked an effect that turns the tool, and orientations had less weight.
TEST(Fit, MissingEffectAdded_OrientationsRegainTheirWeight) {
  json lacking = testing::geometry_model();
  lacking["effects"].push_back("transmission_pwl");
  json whole = lacking;
  whole["effects"].push_back({{"effect", "custom"},
                              {"name", "wrist"},
                              {"coordinate", "tool.rz"},
                              {"expression", "sin(2*q6)"}});
  Random random(59);
  const Problem p(testing::industrial_arm(), whole, {240, true, 1, 1e-5, 2e-5, {}}, random,
                  [&](const Parameter& q) {
                    if (q.effect == "transmission_pwl") return testing::normal(random, 2e-5);
                    return q.effect == "custom" ? 2e-3 : field_error(q, random);
                  });
  const auto fresh = fit_of(p, whole), start = fit_of(p, lacking);
  EXPECT_GT(start->measurements().sigma_rotation, 10 * fresh->measurements().sigma_rotation);
  EXPECT_GT(start->start_point().orientation_inflation, 4.0);
  FitOptions options = start->options();
  options.start = std::make_shared<StartPoint>(start->start_point());
  const auto after = fit_of(p, whole, options);
  EXPECT_NEAR(after->measurements().sigma_rotation, fresh->measurements().sigma_rotation,
              0.3 * fresh->measurements().sigma_rotation);
}

// The errors that a missing effect causes in many rows are not gross errors.
TEST(Fit, MissingEffect_CausesNoRejectedRows) {
  Random random(54);
  json truth = testing::geometry_model();
  truth["effects"].push_back({{"effect", "gear_harmonics"}, {"joints", {2}}});
  const Problem p(testing::industrial_arm(), truth, {150, false, 1, 1e-5, 2e-5, {}}, random,
                  [&](const Parameter& q) {
                    return q.effect == "gear_harmonics" ? 3e-4 : field_error(q, random);
                  });
  EXPECT_TRUE(fit_of(p)->rejected().empty());
}

// The tracker lost one reading: from there on each row holds the position of the next pose.
TEST(Fit, BlockOfRowsShiftedByOnePose_IsRejected) {
  Problem p = geometry_problem(57, {150, false, 1, 1e-5, 2e-5, {}});
  const auto right = fit_of(p);
  const std::size_t rows = p.columns["x"].size(), lost = rows - rows / 5;
  for (const char* axis : {"x", "y", "z"}) {
    std::vector<double>& values = p.columns[axis];
    std::rotate(values.begin() + static_cast<std::ptrdiff_t>(lost),
                values.begin() + static_cast<std::ptrdiff_t>(lost) + 1, values.end());
  }
  const auto fit = fit_of(p);
  EXPECT_EQ(fit->rejected().size(), rows - lost);
  for (const RejectedRow& row : fit->rejected()) EXPECT_GE(row.row, lost);
  EXPECT_LT(fit->held_out_error().mean, 1.2 * right->held_out_error().mean);
}

TEST(Fit, HeldOutErrorsMatchRefits) {
  const Problem p = geometry_problem(55, {90, false, 1, 1e-5, 2e-5, {}});
  FitOptions options;
  options.reject_gross_errors = false;
  const auto fit = fit_of(p, testing::geometry_model(), options);
  const std::vector<int> folds = make_folds(fit->design(), Folding::kRandom, 5, 0);
  const std::vector<double> linearised =
      held_out_distances(fit->design(), evaluate_rows(fit->design()), {folds}, 5,
                         fit->smoothness_sigma())
          .front();
  for (int fold = 0; fold < 5; ++fold) {
    std::vector<std::size_t> inside, outside;
    for (std::size_t i = 0; i < folds.size(); ++i)
      (folds[i] == fold ? outside : inside).push_back(i);
    State::Columns train, test;
    for (const auto& [name, values] : p.columns) {
      for (const std::size_t i : inside) train[name].push_back(values[i]);
      for (const std::size_t i : outside) test[name].push_back(values[i]);
    }
    const auto refit =
        Fit::run(p.robot, train, ModelSpecification::from_json(testing::geometry_model()), options);
    json document = refit->document();
    document["robot"] = testing::industrial_arm();
    const std::vector<Pose> predicted =
        FittedModel::from_json(document).predict(test, std::vector<int>(outside.size(), 0));
    double real = 0.0, quick = 0.0;
    for (std::size_t k = 0; k < outside.size(); ++k) {
      const Eigen::Vector3d seen(test["x"][k], test["y"][k], test["z"][k]);
      real += (predicted[k].translation() - seen).squaredNorm();
      quick += linearised[outside[k]] * linearised[outside[k]];
    }
    EXPECT_NEAR(std::sqrt(quick / real), 1.0, 0.02) << "fold " << fold;
  }
}

TEST(Fit, DocumentPredictsWhatTheFitPredicts) {
  Random random(56);
  json model = testing::geometry_model();
  for (const json& e : {json("joint_compliance"), json("thermal_expansion"), json("warm_up"),
                        json{{"effect", "transmission_pwl"}, {"joints", {1}}}}) {
    model["effects"].push_back(e);
  }
  const Problem p(testing::industrial_arm(), model, {200, false, 2, 1e-5, 2e-5, {}}, random,
                  [&](const Parameter& q) {
                    return q.bound > 0.0 ? 0.05 * testing::normal(random, q.bound) : 0.0;
                  });
  const auto fit = fit_of(p, model);
  json document = json::parse(fit->document().dump());
  document["robot"] = testing::industrial_arm();
  const std::vector<Pose> predicted =
      FittedModel::from_json(document).predict(p.columns, fit->measurements().target);
  for (std::size_t i = 0; i < predicted.size(); ++i) {
    EXPECT_LT((predicted[i].translation() - fit->design().predict(i).translation()).norm(), 1e-9);
  }
}

TEST(Fit, FixedParametersStayAndPriorsAreObeyed) {
  const Problem p = geometry_problem(57);
  json model = testing::geometry_model();
  model["parameters"]["joint_offset[2]"] = {{"fixed", 1e-3}};
  model["parameters"]["link_geometry[4].tx"] = {{"prior", 5e-4}, {"sigma", 1e-9}};
  const auto fit = fit_of(p, model);
  for (const json parameters = fit->document()["parameters"]; const json& q : parameters) {
    if (q["name"] == "joint_offset[2]") {
      EXPECT_EQ(q["value"].get<double>(), 1e-3);
      EXPECT_TRUE(q["fixed"].get<bool>());
    }
    if (q["name"] == "link_geometry[4].tx" && !q["held"].get<bool>()) {
      EXPECT_NEAR(q["value"].get<double>(), 5e-4, 1e-8);
    }
  }
}

TEST(Fit, HeldParametersStandAtNominal) {
  const Problem p = geometry_problem(58);
  for (const json parameters = fit_of(p)->document()["parameters"]; const json& q : parameters) {
    if (q["held"].get<bool>()) {
      EXPECT_EQ(q["value"].get<double>(), 0.0) << q["name"];
    }
  }
}

// The instrument's ellipsoids are weights: a far reflector counts less across the line of sight.
TEST(Fit, InstrumentWeights_LowerTheError) {
  Random random(59);
  Instrument tracker;
  tracker.position = {0.0, 0.0, 0.0};
  tracker.radial_a = 1e-6;
  tracker.angular_a = 1e-5;
  tracker.angular_b = 6e-5;
  double weighted = 0.0, plain = 0.0;
  for (int round = 0; round < 4; ++round) {
    Problem p(testing::industrial_arm(), testing::geometry_model(), {100, false, 1, 0.0, 0.0, {}},
              random, [&](const Parameter& q) { return field_error(q, random); });
    const Measurements exact = p.measurements;
    FitOptions with;
    with.instrument = tracker;
    for (std::size_t i = 0; i < 100; ++i) {
      const Eigen::Vector3d point = exact.position.col(static_cast<Eigen::Index>(i));
      const Eigen::Vector3d u = point.normalized();
      const Eigen::Vector3d white = testing::normal3(random, 1.0);
      const double across = tracker.angular_a + tracker.angular_b * point.norm();
      const Eigen::Vector3d noise =
          across * (white - u * u.dot(white)) + tracker.radial_a * u * u.dot(white);
      p.columns["x"][i] += noise.x();
      p.columns["y"][i] += noise.y();
      p.columns["z"][i] += noise.z();
    }
    const auto error = [&](const FitOptions& options) {
      const auto fit = fit_of(p, testing::geometry_model(), options);
      double sum = 0.0;
      for (std::size_t i = 0; i < 100; ++i) {
        sum += (fit->design().predict(i).translation() -
                exact.position.col(static_cast<Eigen::Index>(i)))
                   .squaredNorm();
      }
      return sum;
    };
    weighted += error(with);
    plain += error({});
  }
  EXPECT_LT(weighted, 0.7 * plain);
}

TEST(Instrument, FromJsonReadsTheFormOfModelYaml) {
  const Instrument i = Instrument::from_json(json::parse(
      R"({"position": [1, 2, 3], "radial": {"a": 5e-6, "b": 5e-7}, "angular": {"a": 7e-6}})"));
  EXPECT_EQ(i.position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(i.radial_b, 5e-7);
  EXPECT_EQ(i.angular_a, 7e-6);
  EXPECT_EQ(i.angular_b, 0.0);
}

TEST(Fit, NoiseFloorComesFromRepeatsThenFromSigma) {
  Problem p = geometry_problem(71, {120, false, 1, 2e-5, 2e-5, {}});
  EXPECT_EQ(fit_of(p)->noise_floor().source, "none");
  p.columns["sigma"].assign(120, 2e-5);
  EXPECT_EQ(fit_of(p)->noise_floor().source, "sigma");
  EXPECT_NEAR(fit_of(p)->noise_floor().mean, 2e-5 * 1.596, 1e-8);

  // Each pose four times: the rows of one pose differ by noise alone.
  Random random(72);
  State::Columns repeated;
  for (std::size_t i = 0; i < 120; ++i) {
    for (int k = 0; k < 4; ++k) {
      for (const auto& [name, values] : p.columns) {
        const bool measured = name == "x" || name == "y" || name == "z";
        repeated[name].push_back(values[i] + (measured ? testing::normal(random, 1e-5) : 0.0));
      }
      repeated["repeat"].push_back(static_cast<double>(i));
    }
  }
  const auto fit =
      Fit::run(p.robot, repeated, ModelSpecification::from_json(testing::geometry_model()), {});
  EXPECT_EQ(fit->noise_floor().source, "repeats");
  EXPECT_NEAR(fit->noise_floor().mean, 1e-5 * 1.596, 1.5e-6);
}

TEST(Fit, NoiseFloor_WithoutRepeatsOrSigma_IsFromReflectors) {
  // Rows i, i+1, i+2 are three reflectors at one pose: rigid, so that distances scatter by noise
  // alone.
  const std::size_t poses = 60;
  Problem p = geometry_problem(76, {3 * poses, false, 3, 0.0, 0.0, {}});
  for (auto& [name, values] : p.columns) {
    if (name == "target" || name == "x" || name == "y" || name == "z") continue;
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = values[i - i % 3];
  }
  Random random(77);
  const std::vector<Pose> exact = predict_poses(State(p.robot, p.columns, Eigen::Vector3d::Zero()),
                                                p.measurements.target, p.model, *p.kinematics);
  for (std::size_t i = 0; i < exact.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      p.columns[std::string(1, static_cast<char>('x' + axis))][i] =
          exact[i].translation()[axis] + testing::normal(random, 2e-5);
    }
  }
  const auto fit =
      Fit::run(p.robot, p.columns, ModelSpecification::from_json(testing::geometry_model()), {});
  EXPECT_EQ(fit->noise_floor().source, "targets");
  EXPECT_NEAR(fit->noise_floor().mean, 2e-5 * 1.596, 3e-6);
}

TEST(Fit, NoiseFloorOfDriftedRepeats_IsLimitedByTheResiduals) {
  // Twelve poses of the beginning are measured again at the end, after the base has moved; the
  // model does not depend on time.
  Problem p = geometry_problem(78, {120, false, 1, 1e-5, 2e-5, {}});
  for (std::size_t i = 0; i < 120; ++i) {
    p.columns["time"].resize(120);
    p.columns["time"][i] = 60.0 * static_cast<double>(i);
    p.columns["repeat"].push_back(static_cast<double>(i));
  }
  for (auto& [name, values] : p.columns) {
    for (std::size_t i = 0; i < 12; ++i)
      values.push_back(name == "time" ? 7200.0 + 60.0 * static_cast<double>(i) : values[i]);
  }
  for (std::size_t i = 120; i < 132; ++i) p.columns["z"][i] += 2e-4;
  FitOptions options;
  options.reject_gross_errors = false;
  const auto fit = fit_of(p, testing::geometry_model(), options);
  EXPECT_EQ(fit->noise_floor().source, "repeats");
  EXPECT_LT(fit->noise_floor().mean, 1.25 * fit->train_error().mean);
}

TEST(Fit, RefusesMeasurementsWithoutARow) {
  Problem p = geometry_problem(73, {5, false, 1, 1e-5, 2e-5, {}});
  for (auto& [name, values] : p.columns) values.clear();
  EXPECT_THROW(fit_of(p), ModelError);
}

TEST(Fit, RefusesTooFewPoses) {
  EXPECT_THROW(fit_of(geometry_problem(73, {3, false, 1, 1e-5, 2e-5, {}})), ModelError);
}

TEST(Fit, FivePoses_GiveFiniteResults) {
  const auto fit = fit_of(geometry_problem(74, {5, false, 1, 1e-5, 2e-5, {}}));
  EXPECT_TRUE(fit->covariance().allFinite());
  for (const json parameters = fit->document()["parameters"]; const json& q : parameters)
    EXPECT_TRUE(std::isfinite(q["value"].get<double>()));
}

TEST(Fit, SameInputSameOutput) {
  const Problem p = geometry_problem(75);
  EXPECT_EQ(fit_of(p)->document().dump(), fit_of(p)->document().dump());
}

// If the data determine little but the sum of two coefficients, both cost little more than one.
TEST(Fit, WeaklyDeterminedCoefficient_IsChargedLittle) {
  const Problem p = geometry_problem(67);
  const auto with = [&](const std::vector<std::string>& expressions) {
    json model = testing::geometry_model();
    for (std::size_t i = 0; i < expressions.size(); ++i) {
      model["effects"].push_back({{"effect", "custom"},
                                  {"name", "c" + std::to_string(i)},
                                  {"coordinate", "motor3"},
                                  {"expression", expressions[i]},
                                  {"bound", 1e-3}});
    }
    return fit_of(p, model);
  };
  const double coordinates = static_cast<double>(3 * p.measurements.rows);
  const auto charge = [&](Fit& fit) { return fit.charge_for_unknowns(coordinates); };
  const auto none = with({}), one = with({"sin(3*q3)"}), two = with({"sin(3*q3)", "cos(5*q3)"});
  const auto alike = with({"sin(3*q3)", "sin(3*q3) + 0.008*cos(5*q3)"});
  const double full = std::log(coordinates);
  EXPECT_NEAR(charge(*one) - charge(*none), full, 0.05 * full);
  EXPECT_NEAR(charge(*two) - charge(*none), 2.0 * full, 0.1 * full);
  for (const int parameter : {1, 2}) {
    const int last = static_cast<int>(alike->model().parameters.size()) - parameter;
    ASSERT_GE(alike->design().unknown_of(last), 0) << "is held: nothing to charge";
  }
  EXPECT_GT(charge(*alike) - charge(*none), 1.1 * full);
  EXPECT_LT(charge(*alike) - charge(*none), 1.8 * full);
}

}  // namespace
}  // namespace armtrue
