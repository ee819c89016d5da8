// Choice among possible measurements: criteria that grow with every measurement chosen, and the
// exchange algorithm that maximises one.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <random>
#include <vector>

namespace armtrue {

/// Linear least squares over a growing and shrinking choice of measurements (recursive least
/// squares): every possible measurement is a block of `height` rows of a whitened Jacobian. Adding
/// or removing one costs one product of the Jacobian with `height` columns.
///
/// M = start + Σ JᵢᵀJᵢ over the chosen. With a `difference`, it also keeps the sum of squares that
/// the unknowns cannot explain: min over δ of Σ ‖dᵢ − Jᵢ δ‖², together with what `start` contains.
class MeasurementChoice {
 public:
  /// `jacobian`: (height · measurements) × unknowns, must outlive this; `start`: symmetric
  /// positive.
  MeasurementChoice(const Eigen::MatrixXd& jacobian, int height, const Eigen::MatrixXd& start);
  /// `difference`: height · measurements; `gradient`, `squares`: Jᵀd and Σ d² of the measurements
  /// that are part of `start`.
  MeasurementChoice(const Eigen::MatrixXd& jacobian, int height, const Eigen::MatrixXd& start,
                    const Eigen::VectorXd& difference, const Eigen::VectorXd& gradient,
                    double squares);

  std::size_t count() const { return leverage_.size(); }
  int height() const { return height_; }
  /// Increase of log det M if measurement i is added.
  double log_determinant_gain(std::size_t i) const;
  /// Increase of left() if measurement i is added.
  double left_gain(std::size_t i) const;
  /// Sum of squares that the unknowns cannot explain, for the present choice.
  double left() const { return left_; }
  /// log det M less that of `start`.
  double log_determinant() const { return log_determinant_; }

  void add(std::size_t i) { change(i, 1.0); }
  void remove(std::size_t i) { change(i, -1.0); }

 private:
  static constexpr int kHeight = 6;
  using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kHeight, kHeight>;
  using Part = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kHeight, 1>;
  void change(std::size_t i, double sign);
  // Cholesky factor of I + Jᵢ M⁻¹ Jᵢᵀ.
  Eigen::LLT<Block> grown(std::size_t i) const;
  void solve_anew();
  auto rows_of(std::size_t i) const {
    return jacobian_->middleRows(static_cast<Eigen::Index>(i) * height_, height_);
  }

  const Eigen::MatrixXd* jacobian_;
  int height_;
  Eigen::MatrixXd information_;  // M
  double start_log_determinant_;
  Eigen::MatrixXd covariance_;   // M⁻¹
  std::vector<Block> leverage_;  // Jᵢ M⁻¹ Jᵢᵀ of every measurement
  double log_determinant_ = 0.0;
  int changes_ = 0;
  // With a difference: d, Jᵀd and Σ d² over start and choice, and dᵢ − Jᵢ δ of every measurement.
  Eigen::VectorXd difference_, gradient_;
  double squares_ = 0.0;
  std::vector<Part> error_;
  double left_ = 0.0;
};

/// Value of a choice of measurements; more is better.
class Criterion {
 public:
  /// D-optimality: log det of the information of all unknowns.
  explicit Criterion(MeasurementChoice choice) : rivals_(false) {
    choices_.push_back(std::move(choice));
  }
  /// T-optimality (Atkinson and Fedorov 1975) for any number of rivals: each in turn is taken as
  /// the truth, and the value is the least sum of squares that a wrong rival leaves. A thousandth
  /// of the mean breaks ties. One choice for each ordered pair (truth, rival): left() is what the
  /// rival cannot explain of the truth.
  explicit Criterion(std::vector<MeasurementChoice> pairs) : choices_(std::move(pairs)) {}

  std::size_t count() const { return choices_.front().count(); }
  double value() const;
  /// value() if measurement i is added.
  double value_with(std::size_t i) const;
  void add(std::size_t i) {
    for (MeasurementChoice& choice : choices_) choice.add(i);
  }
  void remove(std::size_t i) {
    for (MeasurementChoice& choice : choices_) choice.remove(i);
  }

 private:
  std::vector<MeasurementChoice> choices_;
  bool rivals_ = true;
};

/// Chooses `count` different measurements among `allowed` (all of them, if fewer) one by one, each
/// time the best. Leaves the criterion at the choice. `step` receives the share done.
std::vector<std::size_t> choose_greedily(Criterion& criterion, std::size_t count,
                                         const std::vector<bool>& allowed,
                                         const std::function<void(double)>& step = {});

/// The same, followed by exchange (Fedorov 1972; Mitchell 1974): each chosen measurement is
/// replaced by the best available one, until a whole pass changes nothing.
std::vector<std::size_t> choose_best(Criterion& criterion, std::size_t count,
                                     const std::vector<bool>& allowed,
                                     const std::function<void(double)>& step = {});

/// `count` different numbers below `size`, in random order.
std::vector<std::size_t> choose_random(std::size_t size, std::size_t count,
                                       std::mt19937_64& generator);

/// Uniform number in [0, 1), the same on every standard library.
double uniform(std::mt19937_64& generator);

}  // namespace armtrue
