#include "fitter/solve/information.h"

#include <algorithm>
#include <cmath>

#include "fitter/inference/replicates.h"

namespace armtrue {

double bayesian_information(Fit& fit) {
  Design& design = fit.design();
  Design::Row row;
  std::vector<std::size_t> rows;
  std::vector<double> position, rotation;
  for (std::size_t i = 0; i < design.rows(); ++i) {
    if (design.weights()[i] == 0.0) continue;
    design.evaluate(i, false, row);
    position.insert(position.end(), row.residual.data(), row.residual.data() + 3);
    rotation.insert(rotation.end(), row.residual.data() + 3, row.residual.data() + 6);
    rows.push_back(i);
  }
  const Replicates replicates(fit.measurements(), rows);
  // A rejected row counts as the largest residual that would have been kept (8² sigma²), so that
  // rejecting a row never lowers the criterion.
  constexpr double kRejected = 64.0;
  const double total = static_cast<double>(design.rows());
  const double kept = std::max(1.0, static_cast<double>(rows.size()));
  const double rejected = (total - static_cast<double>(rows.size())) * kRejected / kept;
  const auto misfit = [&](const std::vector<double>& values, double penalty, double scale) {
    Eigen::VectorXd white =
        Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()));
    const double correlation = replicates.correlation(white, 3);
    replicates.whiten(white, 3, correlation);
    return 3.0 * total *
               std::log((white.squaredNorm() + penalty) * scale * scale * (1.0 + rejected)) +
           3.0 * replicates.log_determinant(correlation);
  };
  double value = misfit(position, fit.tables_evidence().penalty, fit.noise_scale());
  if (design.residuals_per_row() == 6)
    value += misfit(rotation, 0.0, fit.measurements().sigma_rotation);
  return value + fit.charge_for_unknowns(total * design.residuals_per_row());
}

}  // namespace armtrue
