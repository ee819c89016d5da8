// Structure that no effect of the catalogue explains: nonparametric tests of the residual against
// every state variable, singly and in pairs, on every axis.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "fitter/diagnose/scoring/finding.h"
#include "fitter/evidence/linearization.h"
#include "fitter/evidence/noise.h"

namespace armtrue {

struct Candidate;
struct EvidenceSummary;

struct Structure {
  std::vector<StructureFinding> findings;  ///< significant ones, best first
  std::size_t tried = 0;
};

/// Tests all variables of the data. Findings have a corrected log10 p below `threshold`.
Structure find_structure(const Scorer& scorer, const Fit& fit, double threshold);

/// Whether the residual exceeds measurement noise and repeatability: lack of fit against repeats,
/// with each pose weighted by the scatter of its joints and reading, or against a stated sigma.
struct LackOfFit {
  bool testable = false;
  double log10_p = 0.0;
  std::string against;  ///< "repeats" or "sigma"
};
LackOfFit lack_of_fit(const Linearization& linearization, const Fit& fit, NoiseParts noise);

/// The step of the file's joint angles, for joints that scatter as much as rounding to it makes
/// them: the coarsest of several. Size 0: none.
DecimalStep rounding_of_joints(const NoiseParts& noise, const Fit& fit);

/// "joint 2 repeats to 100 urad, joint 3 to 26 urad; readings scatter by 17.0 um a coordinate".
/// Names joints whose scatter moves the tool by at least half of the readings' scatter, worst
/// first; if no pose was measured again, says that an error of the joint would look the same.
std::string words_of(const NoiseParts& noise, const Linearization& linearization,
                     const Robot& robot);

/// The joint along whose motion the largest share of the unexplained error lies. Of three equal
/// directions, one would hold a third of the error.
struct JointScatter {
  int joint = 0;         ///< 1-based; 0: along none in particular
  double share = 0.0;    ///< of the squares, along that joint's column
  double log10_p = 0.0;  ///< F test, corrected for the number of joints
  bool between_repeats =
      false;  ///< of the differences between repeats of one pose; else of the residual
};
/// From the differences between repeats if these are significant, else from the residual.
JointScatter scatter_along_joints(const Linearization& linearization, const Fit& fit);

/// Gross errors that lie close together in one joint's angle. Reflectors are bumped anywhere, so
/// these indicate a local error of the arm.
struct GrossCluster {
  int joint = 0;  ///< 1-based; 0: none
  int poses = 0;
  double low = 0.0, high = 0.0;  ///< [rad or m]
  double log10_p = 0.0;  ///< of lying so close by chance, corrected for the number of joints
};
GrossCluster gross_errors_together(const Fit& fit);
/// "22 poses kept out as gross errors all have q2 between 0.04 and 0.32".
std::string gross_words(const GrossCluster& cluster);

/// Mean square difference between the residuals of nearest neighbours in joint space, divided by
/// twice the mean square residual: well below 1 if the residual is a smooth function of the joints,
/// 1 if it is noise.
double neighbour_ratio(const Linearization& linearization, const State& state);

/// Probability that the cause of block `b` is present in another form than the catalogue's: that of
/// all smooth functions of the same variables, if one of the best acts on the same bodies and `b`
/// alone explains most of what they do. A tracker's creep that slows down is still a creep, which
/// the catalogue has as a straight line. Else 0; also 0 if `b` reads the arm's posture (where the
/// form identifies the effect), or the fit already has an effect of the same variables.
double as_nearest_name(const Fit& fit, const EvidenceSummary& evidence, std::size_t b);

/// Lowers the probability of candidates that explain less than a structure (a smooth function that
/// no effect explains): they may only compensate errors of that function. Exempt are those that are
/// significant without the structure and either explain as much beside it (a wave of many cycles)
/// or depend on a variable that it does not read (time, a direction; the posture, if the structure
/// is a knock).
void doubt_beside_structure(const Fit& fit, const EvidenceSummary& evidence,
                            std::vector<Candidate>& candidates, double& nothing);

/// Whether a model has a table over several variables.
bool has_grid(const Model& model);

/// A grid of the fit follows any function of its joints, up to the size of its cells: an effect
/// that explains less than the grid may only compensate for that size.
class GridDoubt {
 public:
  GridDoubt(const Fit& fit, const Linearization& linearization, const EvidenceSummary& evidence);
  /// Factor on the probability of an effect that explains `gain` of the squared residual: 1 if the
  /// fit has no grid, or the effect reads more than the posture of the grid's joints.
  double share_left(const Block& block, double gain) const;

 private:
  const Fit& fit_;
  std::set<std::string> axes_;
  double by_grid_ = 0.0;
};

/// Multiplies the probabilities of candidates by GridDoubt::share_left.
void doubt_beside_grid(const GridDoubt& grid, std::vector<Candidate>& candidates, double& nothing);

}  // namespace armtrue
