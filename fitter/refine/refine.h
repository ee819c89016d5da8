// Refinement: diagnoses and changes the model until nothing is missing and nothing is superfluous.
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
  /// Labels of the given fit's effects that an earlier search added; the owner of the arm specified
  /// the others.
  std::set<std::string> searched;
  std::function<void(const RefineStep&)> on_step;  ///< called by the thread that refines
};

/// The steps: the first is the given fit, and the last one's fit is the result.
std::vector<RefineStep> refine(std::shared_ptr<Fit> fit, const RefineOptions& options,
                               Observer& observer = Observer::none());

}  // namespace armtrue
