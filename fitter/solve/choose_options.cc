#include "fitter/solve/choose_options.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace armtrue {
namespace {

constexpr int kFolds = 4;
// A finer form must lower the held-out error to this share of it: less is chance of the folds.
constexpr double kWorthRefining = 0.995;
// Standard deviations of second differences that are tried [m or rad].
constexpr double kSmoothnessesTried[] = {1e-5, 4e-5, 1.5e-4, 5e-4};

// Held-out error (root mean square, [m]) of `base` with one more effect.
double held_out_rms(Fit& base, const EffectRequest& request, const std::vector<int>& fold_of_row) {
  ModelSpecification specification = base.specification();
  specification.effects.push_back(request);
  Model model = build_model(specification, base.context());
  const Model& fitted = base.model();
  for (std::size_t i = 0; i < fitted.parameters.size(); ++i) {
    model.parameters[i].value = fitted.parameters[i].value;
  }
  for (std::size_t j = 0; j < fitted.nonlinear.size(); ++j) {
    model.nonlinear[j].value = fitted.nonlinear[j].value;
  }
  Design design(base.state(), base.measurements(), model, base.kinematics());
  design.weights() = base.design().weights();
  std::vector<int> free = base.design().free_parameters();
  for (std::size_t i = fitted.parameters.size(); i < model.parameters.size(); ++i) {
    free.push_back(static_cast<int>(i));
  }
  design.set_free(free);
  double least = std::numeric_limits<double>::infinity();
  const EvaluatedRows evaluated = evaluate_rows(design);
  for (const double smoothness : kSmoothnessesTried) {
    const std::vector<double> distances =
        held_out_distances(design, evaluated, {fold_of_row}, kFolds, smoothness).front();
    least = std::min(least, summarise_finite(distances).rms);
  }
  return least;
}

EffectRequest close(Fit& base, const EffectRequest& open) {
  const Effect& effect = find_effect(open.effect);
  const std::vector<int> folds =
      make_folds(base.design(), Folding::kRandom, kFolds, base.options().seed + 1);
  EffectRequest best = effect.refinements(base.context(), open).front();
  double least = held_out_rms(base, best, folds);
  for (bool finer = true; finer;) {
    finer = false;
    const double before = least;
    for (const EffectRequest& request : effect.refinements(base.context(), best)) {
      const double error = held_out_rms(base, request, folds);
      if (error >= std::min(least, kWorthRefining * before)) continue;
      least = error;
      best = request;
      finer = true;
    }
  }
  return best;
}

// True if the request leaves options open: its single refinement then states more options.
bool is_open(const EffectContext& context, const EffectRequest& request) {
  const auto forms = find_effect(request.effect).refinements(context, request);
  return forms.size() == 1 && request.options.size() < forms.front().options.size();
}

}  // namespace

ModelSpecification close_options(const State& state, const ModelSpecification& specification,
                                 const FitOptions& options) {
  const EffectContext context{state};
  ModelSpecification closed = specification;
  std::vector<EffectRequest> open;
  std::erase_if(closed.effects, [&](const EffectRequest& request) {
    if (!is_open(context, request)) return false;
    open.push_back(request);
    return true;
  });
  if (open.empty()) return specification;
  FitOptions quick = options;
  quick.cross_validate = false;
  for (const EffectRequest& request : open) {
    const std::unique_ptr<Fit> base = Fit::run(state.robot(), state.columns(), closed, quick);
    closed.effects.push_back(close(*base, request));
  }
  return closed;
}

}  // namespace armtrue
