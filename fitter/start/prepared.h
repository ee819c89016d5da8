// Data that all fits to the same measurements share.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fitter/start/align.h"

namespace armtrue {

/// Never changed after prepare().
struct Prepared {
  Robot robot;
  std::unique_ptr<const State> state;  ///< loads of the nominal arm
  Measurements measurements;
  Alignment alignment;
  std::vector<std::string> warnings;
};

/// Accuracy of measurements whose file does not state it.
struct Accuracies {
  std::optional<Instrument> instrument;
  double assumed_sigma;   ///< [m]
  double sigma_rotation;  ///< [rad]
};

/// Reads and aligns the measurements. Throws ModelError.
std::shared_ptr<const Prepared> prepare(const Robot& robot, const State::Columns& columns,
                                        const Accuracies& accuracies);

}  // namespace armtrue
