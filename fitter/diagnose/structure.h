// Structure that no effect of the catalogue names: nonparametric tests of the residual against
// every state variable, singly and in pairs, on every axis.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "fitter/diagnose/scorer.h"
#include "fitter/evidence/linearization.h"
#include "fitter/evidence/noise.h"

namespace armtrue {

struct Candidate;
struct EvidenceSummary;

/// A nonparametric block: a smooth function of one or two variables on one coordinate.
struct StructureFinding {
  std::vector<std::string> variables;  ///< "q2", "payload" …
  std::vector<int> joints;             ///< joints of the variables and of the coordinate, 1-based
  std::string coordinate;              ///< where it acts: "motor3"
  Block block;
  BlockScore score;
  double log10_p = 0.0;       ///< corrected for the number of blocks tried
  double cost = 0.0;          ///< BIC with it minus without, in the form that suits it best
  std::string shape;          ///< in words
  bool has_own_form = false;  ///< its block is what is weighed, in place of a smooth function
  std::size_t nodes = 0;      ///< over its variable, where it needs more than others; 0: as others
  std::vector<double> x,
      y;  ///< the fitted function over the first variable [rad or m], for drawing
};

struct Structure {
  std::vector<StructureFinding> findings;  ///< significant ones, best first
  std::size_t tried = 0;
};

/// Finds the likeliest step in time: of the base (a knocked tracker), of all reflectors or one
/// (taken out and put back), or of the load. Leaves `log10_p` to the caller. Returns nothing if a
/// smooth change over time of the same coordinates explains clearly more, or if no time was
/// recorded.
std::optional<StructureFinding> find_knock(const Scorer& scorer, const Fit& fit);

/// True where a column `payload` has more than one value.
bool payload_varies(const State& state);

/// A base that swings many times in a session (air conditioning, the sun between clouds): the
/// likeliest course over time on one axis, with `log10_p` not yet set. None where slower courses
/// show as much, or where no time was recorded.
std::optional<StructureFinding> find_swings(const Scorer& scorer, const State& state);

/// The joint whose error follows the direction of its motion from row to row, where its direction
/// of approach is not recorded: the likeliest one, with `log10_p` not yet set.
std::optional<StructureFinding> find_motion(const Scorer& scorer, const State& state);

/// Tests all variables that the data have. A finding has a corrected log10 p below `threshold`.
Structure find_structure(const Scorer& scorer, const Fit& fit, double threshold);

/// Whether the residual is more than measurement and repeatability make: lack of fit against
/// repeats, each pose by what its joints and a reading scatter there, or against a stated sigma.
struct LackOfFit {
  bool testable = false;
  double log10_p = 0.0;
  std::string against;  ///< repeats, sigma
};
LackOfFit lack_of_fit(const Linearization& linearization, const Fit& fit, NoiseParts noise);

/// The step in which the file has the joints, where joints scatter as much as rounding to it makes
/// them: the coarsest of several. Size 0: none does.
DecimalStep rounding_of_joints(const NoiseParts& noise, const Fit& fit);

/// "joint 2 repeats to 100 urad, joint 3 to 26 urad; readings scatter by 17.0 um a coordinate".
/// Joints are named whose scatter moves the tool by no less than half of what readings scatter by,
/// the worst of them first.
std::string words_of(const NoiseParts& noise, const Linearization& linearization,
                     const Robot& robot);

/// Along which joint's motion errors lie that no recorded variable explains: of three equal
/// directions one would hold a third of them.
struct JointScatter {
  int joint = 0;         ///< 1-based; 0: along none in particular
  double share = 0.0;    ///< of the squares, along that joint's column
  double log10_p = 0.0;  ///< F test, corrected for the number of joints
  bool between_repeats =
      false;  ///< of the differences between repeats of one pose; else of the residual
};
/// Of the repeats' differences where there are enough, else of the residual.
JointScatter scatter_along_joints(const Linearization& linearization, const Fit& fit);

/// Poses kept out as gross errors that lie close together in one joint's angle, where reflectors
/// are bumped anywhere: an error of the arm that stands out there.
struct GrossCluster {
  int joint = 0;  ///< 1-based; 0: none
  int poses = 0;
  double low = 0.0, high = 0.0;  ///< [rad or m]
  double log10_p = 0.0;  ///< of lying so close by chance, corrected for the number of joints
};
GrossCluster gross_errors_together(const Fit& fit);
/// "22 poses kept out as gross errors all have q2 between 0.04 and 0.32".
std::string gross_words(const GrossCluster& cluster);

/// Mean square difference between the residuals of nearest neighbours in joint space over twice the
/// mean square residual: well below 1 where the residual is a smooth function of the joints, 1
/// where it is noise.
double neighbour_ratio(const Linearization& linearization, const State& state);

/// Probability that block `b` is there, although in another form than its own: that of the smooth
/// functions that read what it reads and move what it moves, where it alone explains most of what
/// they do. A tracker's creep that slows down is a creep, which the catalogue has as a straight
/// line. 0 where it is not so, where it reads the arm's posture (there the form is the name), and
/// where the fit has an effect of that cause already.
double as_nearest_name(const Fit& fit, const EvidenceSummary& evidence, std::size_t b);

/// Lowers the probability of candidates that explain less than a structure (a smooth function that
/// no effect names): they may only make up for errors of that function. Spared is what the data
/// show without the structure too, if it explains as much beside the structure as without it (a
/// wave of many cycles), or depends on a variable that the structure does not read (time, a
/// direction; the posture, where the structure is a knock).
void doubt_beside_structure(const Fit& fit, const EvidenceSummary& evidence,
                            std::vector<Candidate>& candidates, double& nothing);

/// Whether a model has a table over several variables.
bool has_grid(const Model& model);

/// A grid of the fit follows whatever its joints do, as far as its cells are fine: an effect that
/// explains less than the grid does may only make up for their size.
class GridDoubt {
 public:
  GridDoubt(const Fit& fit, const Linearization& linearization, const EvidenceSummary& evidence);
  /// What is left of the probability of an effect that explains `gain` of the squared residual: all
  /// where the fit has no grid, or the effect reads more than the posture of the grid's joints.
  double share_left(const Block& block, double gain) const;

 private:
  const Fit& fit_;
  std::set<std::string> axes_;
  double by_grid_ = 0.0;
};

/// Lowers the probability of candidates by what GridDoubt leaves of it.
void doubt_beside_grid(const GridDoubt& grid, std::vector<Candidate>& candidates, double& nothing);

}  // namespace armtrue
