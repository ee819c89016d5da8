#include "fitter/plan/fisher.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "fitter/common/dense.h"
#include "fitter/design/normal_equations.h"
#include "fitter/inference/identifiability.h"

namespace armtrue {
namespace {

// Information that every unknown has in advance, as a share of an average measurement's.
constexpr double kFaint = 1e-6;
constexpr std::size_t kWeakest = 3;
constexpr std::size_t kParts = 4;
// Components below this share of the largest are not named.
constexpr double kNamed = 0.4;

Weakness weakness_of(const Linearised& linearised, const Eigen::VectorXd& direction, double sigma) {
  std::vector<Eigen::Index> order(static_cast<std::size_t>(direction.size()));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) {
    return std::abs(direction[a]) > std::abs(direction[b]);
  });
  Weakness weakness;
  weakness.sigma = sigma;
  const double largest = direction[order.front()];
  for (std::size_t k = 0; k < std::min(kParts, order.size()); ++k) {
    const double part = direction[order[k]];
    if (std::abs(part) < kNamed * std::abs(largest)) break;
    weakness.parts.emplace_back(linearised.name(order[k]), part);
    const char* joint = k == 0 ? "" : (part * largest < 0.0 ? " against " : " with ");
    weakness.words += joint + linearised.words(order[k]);
  }
  return weakness;
}

// Whitened Jacobian of all rows of a design with respect to all its unknowns.
Eigen::MatrixXd whole_jacobian(Design& design) {
  const auto rows = static_cast<Eigen::Index>(design.rows());
  const int height = design.residuals_per_row();
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(rows * height, design.unknowns());
  Design::Row row;
  for (Eigen::Index i = 0; i < rows; ++i) {
    if (design.weights()[static_cast<std::size_t>(i)] == 0.0) continue;
    design.evaluate(static_cast<std::size_t>(i), true, row);
    for (std::size_t u = 0; u < row.unknowns.size(); ++u) {
      all.col(row.unknowns[u]).segment(i * height, height) =
          row.jacobian.col(static_cast<Eigen::Index>(u)).head(height);
    }
  }
  return all;
}

}  // namespace

Linearised::Linearised(Design& design, double smoothness_sigma)
    : height_(design.residuals_per_row()) {
  const auto unknowns = static_cast<Eigen::Index>(design.unknowns());
  const Eigen::MatrixXd all = whole_jacobian(design);
  NormalEquations penalties(unknowns);
  const std::vector<double> values = design.unknown_values();
  for (const PenaltyRow& penalty : penalty_rows(design, smoothness_sigma))
    penalties.add(penalty, values);
  const Eigen::VectorXd mean_square =
      all.colwise().squaredNorm().transpose() / static_cast<double>(design.rows());
  const double largest = mean_square.maxCoeff();
  const auto linear = static_cast<Eigen::Index>(design.free_parameters().size());
  std::vector<double> scale;
  for (Eigen::Index u = 0; u < unknowns; ++u) {
    if (!(mean_square[u] > 1e-30 * largest)) continue;
    active_.push_back(static_cast<int>(u));
    scale.push_back(1.0 / std::sqrt(mean_square[u]));
    if (u < linear) {
      const int index = design.free_parameters()[static_cast<std::size_t>(u)];
      const Parameter& p = design.model().parameters[static_cast<std::size_t>(index)];
      names_.push_back(p.name);
      words_.push_back(describe(p));
    } else {
      names_.push_back(design.model().nonlinear[static_cast<std::size_t>(u - linear)].name);
      words_.push_back(names_.back());
    }
  }
  if (active_.empty())
    throw ModelError("plan: the model has no parameter that any pose sees, expected one");
  scale_ = Eigen::Map<Eigen::VectorXd>(scale.data(), static_cast<Eigen::Index>(scale.size()));
  jacobian_ = all(Eigen::all, active_) * scale_.asDiagonal();
  const Eigen::MatrixXd held = penalties.information.selfadjointView<Eigen::Lower>();
  known_ = scale_.asDiagonal() * held(active_, active_) * scale_.asDiagonal();
  known_.diagonal().array() += kFaint;
}

Eigen::MatrixXd Linearised::jacobian_of(Design& taken) const {
  return whole_jacobian(taken)(Eigen::all, active_) * scale_.asDiagonal();
}

Eigen::MatrixXd Linearised::rows_of(const std::vector<std::size_t>& chosen) const {
  Eigen::MatrixXd rows(static_cast<Eigen::Index>(chosen.size()) * height_, unknowns());
  Eigen::Index at = 0;
  for (const std::size_t i : chosen) {
    rows.middleRows(at, height_) =
        jacobian_.middleRows(static_cast<Eigen::Index>(i) * height_, height_);
    at += height_;
  }
  return rows;
}

Eigen::MatrixXd Linearised::information_of(const std::vector<std::size_t>& chosen) const {
  return square(rows_of(chosen));
}

FisherSpectrum fisher_spectrum(const Linearised& linearised, const Eigen::MatrixXd& information,
                               double sigma, std::size_t reachable) {
  const SymmetricEigen eigen = symmetric_eigen(information);
  FisherSpectrum spectrum;
  const double unit = 1.0 / (sigma * sigma);
  for (const double value : eigen.values) {
    spectrum.eigenvalues.push_back(value * unit);
    spectrum.log_determinant += std::log(std::max(value, 1e-300));
  }
  const std::size_t weakest = std::min(kWeakest, spectrum.eigenvalues.size());
  for (std::size_t k = 0; k < weakest; ++k) {
    spectrum.weakest.push_back(
        weakness_of(linearised, eigen.vectors.col(static_cast<Eigen::Index>(k)),
                    1.0 / std::sqrt(std::max(spectrum.eigenvalues[k], 1e-300))));
  }
  // Positions only: the rows of orientations are in units of their own sigma.
  const Eigen::MatrixXd covariance = ScaledCholesky(information).inverse();
  const Eigen::MatrixXd& jacobian = linearised.jacobian();
  const Eigen::VectorXd variance =
      times(jacobian, covariance).cwiseProduct(jacobian).rowwise().sum();
  double sum = 0.0;
  for (std::size_t i = 0; i < reachable; ++i)
    sum += variance.segment(static_cast<Eigen::Index>(i) * linearised.height(), 3).sum();
  spectrum.prediction_rms =
      sigma * std::sqrt(sum / static_cast<double>(std::max<std::size_t>(reachable, 1)));
  return spectrum;
}

nlohmann::json to_json(const FisherSpectrum& spectrum) {
  nlohmann::json result{{"eigenvalues_per_m2", spectrum.eigenvalues},
                        {"log_determinant", spectrum.log_determinant},
                        {"prediction_rms_um", spectrum.prediction_rms * 1e6},
                        {"weakest", nlohmann::json::array()}};
  for (const Weakness& w : spectrum.weakest) {
    nlohmann::json parts = nlohmann::json::array();
    for (const auto& [name, part] : w.parts)
      parts.push_back({{"parameter", name}, {"component", part}});
    result["weakest"].push_back(
        {{"sigma_um", w.sigma * 1e6}, {"words", w.words}, {"parts", parts}});
  }
  return result;
}

}  // namespace armtrue
