// Diagnose and change the model until nothing is missing and nothing is superfluous.
#pragma once

#include <functional>

#include "fitter/diagnose/diagnose.h"

namespace armtrue {

struct RefineStep {
  std::optional<Candidate> added;  ///< none for the starting point
  std::vector<EffectRequest> removed;
  Diagnosis diagnosis;  ///< of the fit after the change
  nlohmann::json document() const;
  std::shared_ptr<Fit> fit;
};

struct RefineOptions {
  int most_steps = 40;
  /// Labels of effects of the given fit that an earlier search put in; the owner of the arm
  /// believes in the others.
  std::set<std::string> searched;
  std::function<void(const RefineStep&)> on_step;  ///< called by the thread that refines
};

/// Steps, the first being the given fit as it stands. The last step's fit is the result.
std::vector<RefineStep> refine(std::shared_ptr<Fit> fit, const RefineOptions& options,
                               Observer& observer = Observer::none());

}  // namespace armtrue
