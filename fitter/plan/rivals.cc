#include "fitter/plan/rivals.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "fitter/solve/prediction.h"

namespace armtrue {
namespace {

Eigen::Matrix<double, 6, 1> change(const Pose& from, const Pose& to) {
  Eigen::Matrix<double, 6, 1> result;
  result << to.translation() - from.translation(),
      rotation_log(to.linear() * from.linear().transpose());
  return result;
}

}  // namespace

Measurements expected_measurements(const Fit& fit, const std::vector<Pose>& poses) {
  const Measurements& taken = fit.measurements();
  Measurements m;
  m.rows = poses.size();
  m.position.resize(3, static_cast<Eigen::Index>(m.rows));
  for (std::size_t i = 0; i < m.rows; ++i) {
    m.position.col(static_cast<Eigen::Index>(i)) = poses[i].translation();
    if (taken.has_rotation()) m.rotation.push_back(poses[i].linear());
  }
  m.rotation_is_copied.assign(m.rotation.size(), false);
  m.target.assign(m.rows, 0);
  m.whiten_position.assign(m.rows, Eigen::Matrix3d::Identity() / taken.typical_sigma);
  m.sigma_rotation = taken.sigma_rotation;
  m.typical_sigma = taken.typical_sigma;
  return m;
}

Rivals::Rivals(std::vector<std::unique_ptr<Fit>> fits, const Menu& menu)
    : menu_(menu), sharpest_(fits.front().get()) {
  for (const auto& fit : fits) {
    const bool sharper =
        fit->measurements().typical_sigma < sharpest_->measurements().typical_sigma;
    if (sharper) sharpest_ = fit.get();
  }
  for (auto& fit : fits) {
    rivals_.emplace_back();
    rivals_.back().fit = std::move(fit);
    prepare(rivals_.back());
  }
  for (std::size_t truth = 0; truth < rivals_.size(); ++truth) {
    for (std::size_t rival = 0; rival < rivals_.size(); ++rival) {
      if (rival != truth) pairs_.push_back({truth, rival});
    }
  }
}

void Rivals::prepare(Rival& rival) const {
  Fit& fit = *rival.fit;
  const std::vector<EffectRequest>& effects = fit.specification().effects;
  rival.bends = !fit.model().nonlinear.empty() ||
                std::any_of(effects.begin(), effects.end(),
                            [](const EffectRequest& e) { return find_effect(e.effect).generic(); });
  rival.state = std::make_unique<State>(fit.robot(), menu_.columns, fit.state().payload_point());
  rival.predicted = predict_poses(*rival.state, std::vector<int>(rival.state->rows(), 0),
                                  fit.model(), fit.kinematics());
  rival.predicted_taken =
      predict_poses(fit.state(), fit.measurements().target, fit.model(), fit.kinematics());
  rival.expected =
      std::make_unique<Measurements>(expected_measurements(*sharpest_, rival.predicted));
  rival.possible =
      std::make_unique<Design>(*rival.state, *rival.expected, fit.model(), fit.kinematics());
  rival.possible->set_free(fit.design().free_parameters());
  rival.taken = std::make_unique<Design>(fit.state(), sharpest_->measurements(), fit.model(),
                                         fit.kinematics());
  rival.taken->set_free(fit.design().free_parameters());
  rival.taken->weights() = fit.design().weights();
  rival.linearised = std::make_unique<Linearised>(*rival.possible, fit.smoothness_sigma());
  rival.jacobian_taken = rival.linearised->jacobian_of(*rival.taken);
  rival.known = rival.linearised->known() + rival.jacobian_taken.transpose() * rival.jacobian_taken;
}

Rivals::Difference Rivals::difference(const RivalPair& pair,
                                      const std::vector<std::size_t>& rows) const {
  const Rival& truth = rivals_[pair.truth];
  const Rival& rival = rivals_[pair.rival];
  const int height = rival.linearised->height();
  Difference result{Eigen::VectorXd(rival.jacobian_taken.rows()),
                    Eigen::VectorXd(static_cast<Eigen::Index>(rows.size()) * height)};
  for (std::size_t i = 0; i < rival.predicted_taken.size(); ++i) {
    result.taken.segment(static_cast<Eigen::Index>(i) * height, height) =
        rival.taken->whiten(i, change(rival.predicted_taken[i], truth.predicted_taken[i]))
            .head(height);
  }
  for (std::size_t k = 0; k < rows.size(); ++k) {
    const std::size_t i = rows[k];
    result.possible.segment(static_cast<Eigen::Index>(k) * height, height) =
        rival.possible->whiten(i, change(rival.predicted[i], truth.predicted[i])).head(height);
  }
  return result;
}

MeasurementChoice Rivals::choice(const RivalPair& pair) const {
  const Rival& rival = rivals_[pair.rival];
  std::vector<std::size_t> all(rival.predicted.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  const Difference d = difference(pair, all);
  return MeasurementChoice(rival.linearised->jacobian(), rival.linearised->height(), rival.known,
                           d.possible, rival.jacobian_taken.transpose() * d.taken,
                           d.taken.squaredNorm());
}

double Rivals::left(const RivalPair& pair, const std::vector<std::size_t>& rows) const {
  const Difference d = difference(pair, rows);
  const Rival& rival = rivals_[pair.rival];
  const Eigen::MatrixXd jacobian = rival.linearised->rows_of(rows);
  const Eigen::VectorXd gradient =
      rival.jacobian_taken.transpose() * d.taken + jacobian.transpose() * d.possible;
  const ScaledCholesky factor(rival.known + jacobian.transpose() * jacobian);
  const double squares = d.taken.squaredNorm() + d.possible.squaredNorm();
  return std::max(0.0, squares - gradient.dot(factor.solve(gradient)));
}

double Rivals::left_after_refit(const RivalPair& pair, const std::vector<std::size_t>& rows) const {
  const Rival& truth = rivals_[pair.truth];
  const Fit& rival = *rivals_[pair.rival].fit;
  const Measurements& noise = sharpest_->measurements();
  std::vector<Pose> poses = truth.predicted_taken;
  for (const std::size_t row : rows) poses.push_back(truth.predicted[row]);
  State::Columns columns;
  for (const auto& [name, values] : rival.state().columns()) {
    const auto possible = menu_.columns.find(name);
    if (possible == menu_.columns.end()) continue;
    std::vector<double>& column = columns[name] = values;
    for (const std::size_t row : rows) column.push_back(possible->second[row]);
  }
  put_poses(poses, noise.has_rotation(), columns);
  std::vector<double>& target = columns["target"];
  target.assign(noise.target.begin(), noise.target.end());
  target.resize(poses.size(), 0.0);

  FitOptions options = rival.options();
  options.nonlinear_starts.clear();
  options.reject_gross_errors = false;
  options.cross_validate = false;
  const std::unique_ptr<Fit> fit = Fit::run(rival.robot(), columns, rival.specification(), options);
  double left = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Eigen::Matrix<double, 6, 1> missed = change(fit->design().predict(i), poses[i]);
    left += missed.head<3>().squaredNorm() / std::pow(noise.typical_sigma, 2);
    if (noise.has_rotation())
      left += missed.tail<3>().squaredNorm() / std::pow(noise.sigma_rotation, 2);
  }
  return left;
}

// −n log(1 + left / freedom), since the noise is estimated too, and the difference in the penalty
// for unknowns.
double Rivals::bic(double left, const RivalPair& pair, std::size_t poses) const {
  const Fit& truth = *rivals_[pair.truth].fit;
  const Fit& rival = *rivals_[pair.rival].fit;
  const double height = rivals_[pair.rival].linearised->height();
  const double n = height * static_cast<double>(truth.measurements().rows + poses);
  const double freedom = std::max(1.0, n - truth.effective_unknowns());
  return -n * std::log1p(left / freedom) + truth.charge_for_unknowns(n) -
         rival.charge_for_unknowns(n);
}

double Rivals::evidence(const RivalPair& pair, const std::vector<std::size_t>& rows) const {
  return bic(bends(pair) ? left_after_refit(pair, rows) : left(pair, rows), pair, rows.size());
}

}  // namespace armtrue
