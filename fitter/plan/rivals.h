// Rival explanations of one fit's residual, and the evidence that further measurements would give
// between them.
#pragma once

#include <memory>
#include <vector>

#include "fitter/plan/fisher.h"
#include "fitter/plan/menu.h"
#include "fitter/solve/fit.h"

namespace armtrue {

/// One rival against another that is taken for the truth: indices into the rivals.
struct RivalPair {
  std::size_t truth = 0, rival = 0;
};

/// Several fits of the same measurements, each with another effect added, and a menu of further
/// measurements.
class Rivals {
 public:
  /// `menu` must outlive this.
  Rivals(std::vector<std::unique_ptr<Fit>> fits, const Menu& menu);

  std::size_t count() const { return rivals_.size(); }
  Fit& fit(std::size_t rival) { return *rivals_[rival].fit; }
  /// Every ordered pair.
  const std::vector<RivalPair>& pairs() const { return pairs_; }

  /// The menu as a choice whose left-over is what the rival cannot explain of the truth as fitted,
  /// all its unknowns free to follow.
  MeasurementChoice choice(const RivalPair& pair) const;

  /// True where the rival can follow the truth further than its slopes tell, having nonlinear
  /// unknowns or tables that gain nodes where new measurements lie: its evidence costs a fit.
  bool bends(const RivalPair& pair) const { return rivals_[pair.rival].bends; }
  /// BIC of the truth less the rival's that is to be expected after measuring `rows` of the menu,
  /// if the truth is as fitted. A rival that bends is fitted anew.
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
  // Truth less rival, whitened, over rows of the menu below the measurements taken.
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
  const Fit* sharpest_;  // the one that leaves least: its noise is everybody's
};

/// Measurements that find exactly what `poses` predict, each coordinate with a standard deviation
/// as the measurements of `fit` have it.
Measurements expected_measurements(const Fit& fit, const std::vector<Pose>& poses);

}  // namespace armtrue
