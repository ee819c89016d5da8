// Spectra of the residual over each joint's angle: periods that nobody knew of.
#pragma once

#include <vector>

#include "fitter/evidence/linearization.h"

namespace armtrue {

/// Power of the joint-equivalent residual of one joint over cycles per joint turn.
struct JointSpectrum {
  int joint = 1;            ///< 1-based
  double resolution = 1.0;  ///< cycles per turn that the joint's range can tell apart
  std::vector<double> cycles;
  std::vector<double> power;      ///< share of Σ r² that a sine and cosine of that period explain
  std::vector<double> amplitude;  ///< [rad]
};

struct SpectralPeak {
  int joint;
  double cycles, power, amplitude;
};

/// Weighted least-squares periodogram (Lomb–Scargle generalised to vector residuals): random poses
/// do no harm to it. From half a cycle a turn to twice the gear ratio, at most 600 cycles; 300
/// where no ratio is given.
std::vector<JointSpectrum> joint_spectra(const Linearization& linearization, const State& state);
/// The same up to 1200 cycles a turn, whatever the gear ratios are said to be.
std::vector<JointSpectrum> wide_joint_spectra(const Linearization& linearization,
                                              const State& state);

/// The highest separate peaks of a spectrum, strongest first, each refined between the grid's
/// lines.
std::vector<SpectralPeak> highest_peaks(const JointSpectrum& spectrum,
                                        const Linearization& linearization, const State& state,
                                        std::size_t count);

}  // namespace armtrue
