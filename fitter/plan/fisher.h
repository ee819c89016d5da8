// Information in a choice of measurements: the Fisher information of a model's unknowns, its
// spectrum, and its weakest directions in words.
#pragma once

#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "fitter/design/design.h"
#include "fitter/plan/exchange.h"

namespace armtrue {

/// A model linearised at every possible measurement, in scaled unknowns: a change of 1 in an
/// unknown moves the tool by `sigma` metres (root mean square over the possible measurements), so
/// that unknowns of different units are comparable.
class Linearised {
 public:
  /// `design` is evaluated at its present values; unknowns that affect no measurement are left out.
  /// `smoothness_sigma`: of the tables' smoothness penalties, as in the fit.
  Linearised(Design& design, double smoothness_sigma);

  int height() const { return height_; }
  Eigen::Index unknowns() const { return jacobian_.cols(); }
  /// (height · measurements) × unknowns, whitened.
  const Eigen::MatrixXd& jacobian() const { return jacobian_; }
  /// Information of priors, gauges and smoothness, plus a millionth of an average measurement's,
  /// which makes it invertible.
  const Eigen::MatrixXd& known() const { return known_; }
  /// The same Jacobian for another design with the same unknowns: the measurements already taken.
  Eigen::MatrixXd jacobian_of(Design& taken) const;
  /// The Jacobian's rows of the chosen measurements, and their JᵀJ.
  Eigen::MatrixXd rows_of(const std::vector<std::size_t>& chosen) const;
  Eigen::MatrixXd information_of(const std::vector<std::size_t>& chosen) const;
  /// Unknown u in words.
  const std::string& words(Eigen::Index u) const { return words_[static_cast<std::size_t>(u)]; }
  const std::string& name(Eigen::Index u) const { return names_[static_cast<std::size_t>(u)]; }

 private:
  int height_;
  std::vector<int> active_;  // unknowns of the design
  Eigen::VectorXd scale_;    // of the active ones
  Eigen::MatrixXd jacobian_, known_;
  std::vector<std::string> words_, names_;
};

/// A direction in the space of the unknowns, and how precisely it is determined.
struct Weakness {
  double sigma = 0.0;  ///< standard deviation as a motion of the tool [m]
  std::string words;   ///< "link 3's turn about y against axis 2's zero"
  std::vector<std::pair<std::string, double>> parts;  ///< parameter, component of the unit vector
};

/// Spectrum of a Fisher information.
struct FisherSpectrum {
  std::vector<double>
      eigenvalues;  ///< smallest first [1/m²]: 1 / sigma² of orthogonal combinations
  std::vector<Weakness> weakest;  ///< directions of the three smallest eigenvalues
  double log_determinant = 0.0;
  double prediction_rms =
      0.0;  ///< standard deviation of predictions over the reachable poses, root mean square [m]
};

/// `information` in scaled unknowns, priors included; `sigma`: of one measured coordinate [m];
/// `reachable`: number of first measurements over which predictions are judged.
FisherSpectrum fisher_spectrum(const Linearised& linearised, const Eigen::MatrixXd& information,
                               double sigma, std::size_t reachable);

nlohmann::json to_json(const FisherSpectrum& spectrum);

}  // namespace armtrue
