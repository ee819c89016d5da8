// armtrue._core: the fitter in process. Numbers are passed as NumPy arrays, structured content as
// JSON text.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/function.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/set.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <nlohmann/json.hpp>

#include "fitter/evidence/block.h"
#include "fitter/python/arrays.h"
#include "fitter/python/parts.h"
#include "fitter/python/watched.h"
#include "fitter/refine/refine.h"
#include "fitter/solve/information.h"
#include "fitter/solve/prediction.h"

namespace nb = nanobind;
using namespace nb::literals;
using nlohmann::json;

namespace armtrue {
namespace {

std::vector<int> to_targets(const State::Columns& columns) {
  const auto found = columns.find("target");
  if (found == columns.end()) return std::vector<int>(columns.at("q1").size(), 0);
  std::vector<int> target;
  for (const double t : found->second) target.push_back(static_cast<int>(t));
  return target;
}

FitOptions fit_options(const json& given) {
  FitOptions options;
  options.folds = given.value("folds", options.folds);
  options.seed = given.value("seed", options.seed);
  options.assumed_sigma = given.value("assumed_sigma_m", options.assumed_sigma);
  options.sigma_rotation = given.value("sigma_rotation_rad", options.sigma_rotation);
  options.reject_gross_errors = given.value("reject_gross_errors", true);
  options.cross_validate = given.value("cross_validate", true);
  if (given.contains("instrument") && !given["instrument"].is_null()) {
    options.instrument = Instrument::from_json(given["instrument"]);
  }
  return options;
}

std::string align_json(const std::string& robot_json, const std::map<std::string, Column>& arrays) {
  const Robot robot = Robot::from_json(json::parse(robot_json));
  const State::Columns columns = to_columns(arrays);
  const Alignment alignment = watched({}, [&](WatchedCall&) {
    const State state(robot, columns, Eigen::Vector3d::Zero());
    return align(state, Measurements::from_state(state, std::nullopt, 1e-5, 1e-5));
  });
  const auto pose = [](const Pose& p) {
    const Eigen::Vector3d rpy = rpy_from_rotation(p.linear());
    return json{{"xyz", {p.translation().x(), p.translation().y(), p.translation().z()}},
                {"rpy", {rpy.x(), rpy.y(), rpy.z()}}};
  };
  json tools = json::object();
  for (std::size_t t = 0; t < alignment.flange_from_tool.size(); ++t) {
    tools[alignment.flange_from_tool.size() > 1 ? std::to_string(t) : ""] =
        pose(alignment.flange_from_tool[t]);
  }
  return json{{"rms_m", alignment.rms_m},
              {"scale", alignment.scale},
              {"measuring_from_base", pose(alignment.measuring_from_base)},
              {"flange_from_tool", tools},
              {"residual_m", alignment.residual_m},
              {"reach_m", robot.reach()}}
      .dump();
}

std::shared_ptr<Fit> run_fit(const std::string& robot_json,
                             const std::map<std::string, Column>& arrays,
                             const std::string& model_json, const std::string& options_json,
                             std::optional<Progress> progress) {
  const State::Columns columns = to_columns(arrays);
  return watched(std::move(progress), [&](WatchedCall& call) -> std::shared_ptr<Fit> {
    return Fit::run(Robot::from_json(json::parse(robot_json)), columns,
                    ModelSpecification::from_json(json::parse(model_json)),
                    fit_options(json::parse(options_json)), call);
  });
}

Vectors predict(const std::string& document_json, const std::map<std::string, Column>& arrays) {
  const FittedModel fitted = FittedModel::from_json(json::parse(document_json));
  const State::Columns columns = to_columns(arrays);
  const std::vector<Pose> poses =
      watched({}, [&](WatchedCall&) { return fitted.predict(columns, to_targets(columns)); });
  std::vector<double> xyz;
  for (const Pose& pose : poses) {
    xyz.insert(xyz.end(), {pose.translation().x(), pose.translation().y(), pose.translation().z()});
  }
  return to_numpy(std::move(xyz), 3);
}

Vectors position_covariance(const Fit& fit, const std::map<std::string, Column>& arrays) {
  const State::Columns columns = to_columns(arrays);
  const std::vector<Eigen::Matrix3d> covariances = watched({}, [&](WatchedCall&) {
    return predicted_position_covariance(fit, columns, to_targets(columns));
  });
  std::vector<double> values;
  values.reserve(9 * covariances.size());
  for (const Eigen::Matrix3d& c : covariances)
    values.insert(values.end(), c.data(), c.data() + c.size());
  return to_numpy(std::move(values), 9);
}

Vectors residuals(Fit& fit) {
  std::vector<double> xyz;
  for (std::size_t i = 0; i < fit.design().rows(); ++i) {
    const Eigen::Vector3d e = fit.measurements().position.col(static_cast<Eigen::Index>(i)) -
                              fit.design().predict(i).translation();
    xyz.insert(xyz.end(), {e.x(), e.y(), e.z()});
  }
  return to_numpy(std::move(xyz), 3);
}

std::string run_diagnose(Fit& fit, std::optional<Progress> progress, std::set<std::string> searched,
                         std::set<std::string> left_out) {
  DiagnoseOptions options;
  options.searched = std::move(searched);
  options.left_out = std::move(left_out);
  return watched(std::move(progress), [&](WatchedCall& call) {
    return diagnose(fit, options, call).to_json(fit).dump();
  });
}

// Labels of the effects that a search added: those of `refined` that `given` does not have, or has
// only from an earlier search (`searched`).
std::vector<std::string> searched_effects(const Fit& given, const Fit& refined,
                                          const std::set<std::string>& searched) {
  std::set<std::string> believed;
  for (const EffectRequest& request : removable_effects(given)) believed.insert(label(request));
  for (const std::string& name : searched) believed.erase(name);
  std::vector<std::string> labels;
  for (const EffectRequest& request : removable_effects(refined)) {
    if (!believed.contains(label(request))) labels.push_back(label(request));
  }
  return labels;
}

using OnStep = std::function<void(std::shared_ptr<Fit>, const std::string&)>;

std::pair<std::shared_ptr<Fit>, std::string> run_refine(std::shared_ptr<Fit> fit,
                                                        std::optional<OnStep> on_step,
                                                        std::optional<Progress> progress,
                                                        std::set<std::string> searched) {
  RefineOptions options;
  options.searched = std::move(searched);
  const std::vector<RefineStep> steps = watched(std::move(progress), [&](WatchedCall& call) {
    if (on_step) {
      options.on_step = [&](const RefineStep& step) {
        const std::string document = step.document().dump();
        call.on_callers_thread([&] { (*on_step)(step.fit, document); });
      };
    }
    return refine(fit, options, call);
  });
  json result{{"steps", json::array()}};
  for (const RefineStep& step : steps) result["steps"].push_back(step.document());
  result["effects"] = result["steps"].back()["effects"];
  result["left_out"] = json::array();
  for (const Candidate& c : steps.back().diagnosis.candidates) {
    if (c.left_out) result["left_out"].push_back(key_of(c.request));
  }
  return {steps.back().fit, result.dump()};
}

}  // namespace

NB_MODULE(_core, m) {
  m.doc() =
      "Armtrue's fitter (C++20): alignment, fit, prediction, diagnosis. JSON forms: docs/model.md.";
  nb::exception<ModelError>(m, "ModelError", PyExc_ValueError);
  nb::exception<ExpressionError>(m, "ExpressionError", PyExc_ValueError);

  bind_catalogue(m);
  m.def(
      "state_variables",
      [](int joints, const std::vector<std::string>& sensors) {
        json variables = json::array();
        for (const Variable& v : state_variables(joints, sensors))
          variables.push_back({{"name", v.name},
                               {"kind", to_string(v.kind)},
                               {"joint", v.joint},
                               {"sensor", v.sensor}});
        return variables.dump();
      },
      "joints"_a, "sensors"_a,
      "The state variables of an arm with so many joints and these thermometers: JSON of name, "
      "kind, joint, sensor.");
  m.def(
      "parse_expression", [](const std::string& text) { return Expression::parse(text).to_json(); },
      "text"_a, "Parse an expression of the state into nested JSON; raises ExpressionError.");
  m.def(
      "check_expression",
      [](const std::string& text, const std::vector<std::string>& variables,
         const std::vector<std::string>& parameters) {
        for (const std::string& name : Expression::parse(text).variables()) {
          if (std::find(variables.begin(), variables.end(), name) == variables.end() &&
              std::find(parameters.begin(), parameters.end(), name) == parameters.end()) {
            throw ExpressionError("'" + name + "' is neither a state variable nor a parameter");
          }
        }
      },
      "text"_a, "variables"_a, "parameters"_a,
      "Raise ExpressionError where text is no expression of the given names.");
  m.def("align", &align_json, "robot"_a, "columns"_a,
        "Base and tool with nominal kinematics and no initial guess; JSON with rms_m, scale, "
        "poses, residual_m.");
  m.def("predict", &predict, "fit"_a, "columns"_a,
        "Predicted x, y, z [m] in the measuring frame, (N, 3).");

  m.def("position_covariance", &position_covariance, "fit"_a, "columns"_a,
        "Covariance of the predicted positions [m²] without the instrument's noise, 3 × 3 by row, "
        "(N, 9).");

  nb::class_<Fit>(m, "Fit", "A fitted model with its measurements.")
      .def(
          "document", [](const Fit& fit) { return fit.document().dump(); },
          "Everything of fit.json that the numbers know, as JSON.")
      .def(
          "specification", [](const Fit& fit) { return fit.specification().to_json().dump(); },
          "The model as JSON.")
      .def("residuals", &residuals, "Measured minus predicted position [m], (N, 3).")
      .def("bayesian_information", &bayesian_information,
           "BIC up to a constant of the campaign: differences between fits of one campaign are "
           "evidence.");
  m.def("diagnose", &run_diagnose, "fit"_a, "progress"_a = nb::none(),
        "searched"_a = std::set<std::string>{}, "left_out"_a = std::set<std::string>{},
        "What is missing, ranked: the contract's JSON. searched: effects of the fit that a search "
        "put in; left_out: what a refinement fitted beside it and left out, as refine gives it.");
  m.def(
      "untestable",
      [](const Fit& fit) { return to_json(untestable_effects(fit.context())).dump(); }, "fit"_a,
      "What the recorded columns do not allow to test: `untestable` of the diagnosis.");
  m.def("refine", &run_refine, "fit"_a, "on_step"_a = nb::none(), "progress"_a = nb::none(),
        "searched"_a = std::set<std::string>{},
        "Diagnose and add until nothing is missing; on_step(fit, step as JSON). Returns the last "
        "fit and all steps as JSON, with what was fitted and left out.");
  m.def("searched_effects", &searched_effects, "given"_a, "refined"_a, "searched"_a,
        "Names of the effects of `refined` that a search put in: those that `given` has not, or "
        "has among `searched`.");
  m.def("fit", &run_fit, "robot"_a, "columns"_a, "model"_a, "options"_a = "{}",
        "progress"_a = nb::none(),
        "Fit a model; columns are float64 arrays in the contract's names.");
  bind_drawing(m);
  bind_plan(m);
}

}  // namespace armtrue
