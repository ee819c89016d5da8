// The decimal step to which the numbers of a file were rounded.
#pragma once

#include <span>
#include <string>

namespace armtrue {

/// A decimal step that recorded values are multiples of; size 0: of none of the steps tested.
struct DecimalStep {
  double size = 0.0;  ///< in the values' SI unit
  std::string words;  ///< "0.01 deg", "0.1 mm"

  /// Standard deviation of the rounding error: size / √12 (JCGM 100:2008, F.2.2.1).
  double sigma() const;
};

/// The coarsest step, from a millimetre to a micrometre, that all lengths [m] are multiples of.
DecimalStep step_of_lengths(std::span<const double> values);
/// The coarsest decimal step of a degree or of a radian that all angles [rad] are multiples of.
DecimalStep step_of_angles(std::span<const double> values);

}  // namespace armtrue
