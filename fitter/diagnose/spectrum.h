// Spectra of the residual over each joint's angle, which show unknown periods.
#pragma once

#include <vector>

#include "fitter/evidence/linearization.h"

namespace armtrue {

/// Power of the joint-equivalent residual of one joint over cycles per joint turn, or per metre
/// where the joint slides.
struct JointSpectrum {
  int joint = 1;            ///< 1-based
  bool slides = false;      ///< cycles and resolution are per metre, amplitudes metres
  double resolution = 1.0;  ///< cycles that the joint's range can resolve
  double grid = 0.0;        ///< step of the grid of the joint's positions [rad or m]; 0: no grid
  std::vector<double> cycles;
  std::vector<double> power;      ///< share of Σ r² that a sine and cosine of that period explain
  std::vector<double> amplitude;  ///< [rad or m]

  /// The lowest number of cycles that the grid cannot distinguish from `line`; `line` without a
  /// grid.
  double folded(double line) const;
  /// The two lowest aliases of `line` on the grid, of those that any spectrum covers; none without
  /// a grid.
  std::vector<double> aliases(double line) const;

 private:
  /// Numbers of cycles that differ by this are aliases; 0 without a grid.
  double alias_period() const;
};

struct SpectralPeak {
  int joint;
  double cycles, power, amplitude;
  double within;  ///< a line of the same joint fits as well if its power is lower by no more
};

/// Weighted least-squares periodogram (Lomb–Scargle generalised to vector residuals), for which
/// poses may be random. From half a cycle a turn to twice the gear ratio, at most 600 cycles; 300
/// without a known ratio. For a sliding joint: waves from twice its travel down to a thousandth of
/// it, no shorter than 2 mm or two steps of a grid.
std::vector<JointSpectrum> joint_spectra(const Linearization& linearization, const State& state);
/// The same up to 1200 cycles a turn, independent of the stated gear ratios.
std::vector<JointSpectrum> wide_joint_spectra(const Linearization& linearization,
                                              const State& state);

/// The highest separate peaks of a spectrum, strongest first, each refined between the spectrum's
/// lines. Counts per turn, and wavelengths, are the roundest that the residual cannot distinguish
/// from the best.
std::vector<SpectralPeak> highest_peaks(const JointSpectrum& spectrum,
                                        const Linearization& linearization, const State& state,
                                        std::size_t count);

/// Whether noise in so many rows would hardly have a line of this power in the whole spectrum.
bool is_no_chance(const JointSpectrum& spectrum, double power, std::size_t rows);

/// Whether the residual distinguishes a line of `cycles` from a peak of the same joint.
bool is_told_from(const SpectralPeak& peak, double cycles, const Linearization& linearization,
                  const State& state);

}  // namespace armtrue
