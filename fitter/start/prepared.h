// What all fits to the same measurements share.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fitter/start/align.h"

namespace armtrue {

/// Nothing in it changes.
struct Prepared {
  Robot robot;
  std::unique_ptr<const State> state;  ///< loads of the nominal arm
  Measurements measurements;
  Alignment alignment;
  std::vector<std::string> warnings;
};

/// How well measurements are known where their file does not say.
struct Accuracies {
  std::optional<Instrument> instrument;
  double assumed_sigma;   ///< [m]
  double sigma_rotation;  ///< [rad]
};

/// Reads and aligns the measurements. Throws ModelError.
std::shared_ptr<const Prepared> prepare(const Robot& robot, const State::Columns& columns,
                                        const Accuracies& accuracies);

}  // namespace armtrue
