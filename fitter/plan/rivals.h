// Rival explanations of one fit's residual, and the evidence between them that further measurements
// would give.
#pragma once

#include <memory>
#include <vector>

#include "fitter/plan/fisher.h"
#include "fitter/plan/menu.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// One rival, and another that is taken as the truth: indices into the rivals.
struct RivalPair {
  std::size_t truth = 0, rival = 0;
};

/// Several fits of the same measurements, each with another effect added, and a menu of further
/// measurements.
class Rivals {
 public:
  /// `menu` must outlive this.
  Rivals(std::vector<std::unique_ptr<Fit>> fits, const Menu& menu);

  /// Every ordered pair.
  const std::vector<RivalPair>& pairs() const { return pairs_; }

  /// The menu as a choice whose left() is what the rival, with all its unknowns free, cannot
  /// explain of the truth as fitted.
  MeasurementChoice choice(const RivalPair& pair) const;

  /// True if the rival can follow the truth further than its linearisation tells, having nonlinear
  /// unknowns or tables that gain nodes where new measurements lie: its evidence needs a fit.
  bool bends(const RivalPair& pair) const { return rivals_[pair.rival].bends; }
  /// Expected BIC of the truth minus that of the rival after measuring `rows` of the menu, if the
  /// truth is as fitted. A rival that bends is fitted again.
  double evidence(const RivalPair& pair, const std::vector<std::size_t>& rows) const;

 private:
  struct Rival {
    std::unique_ptr<Fit> fit;
    bool bends = false;
    std::unique_ptr<State> state;  // over the menu
    std::unique_ptr<Measurements> expected;
    std::unique_ptr<Design> possible, taken;
    std::unique_ptr<Linearised> linearised;
    std::vector<Pose> predicted, predicted_taken;
    Eigen::MatrixXd jacobian_taken;
    Eigen::MatrixXd known;  // information of priors and measurements taken
  };
  // Truth minus rival, whitened, at the measurements taken and at chosen rows of the menu.
  struct Difference {
    Eigen::VectorXd taken, possible;
  };
  void prepare(Rival& rival) const;
  Difference difference(const RivalPair& pair, const std::vector<std::size_t>& rows) const;
  double left(const RivalPair& pair, const std::vector<std::size_t>& rows) const;
  double left_after_refit(const RivalPair& pair, const std::vector<std::size_t>& rows) const;
  double bic(double left, const RivalPair& pair, std::size_t poses) const;

  const Menu& menu_;
  std::vector<Rival> rivals_;
  std::vector<RivalPair> pairs_;
  const Fit* sharpest_;  // the fit with the smallest noise, which all rivals use
};

/// Measurements that equal the prediction `poses`, each coordinate with the standard deviation of
/// the measurements of `fit`.
Measurements expected_measurements(const Fit& fit, const std::vector<Pose>& poses);

}  // namespace armtrue
