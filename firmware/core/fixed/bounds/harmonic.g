# add_harmonics() of terms.cc: an amplitude (Q32) times a sine that is wrong by less than 2e-9.
# S: the true sine of the angle that multiple() makes; a: the fitted amplitude, rad or m.
# Bound: 1.6e-9 at the largest amplitude that a coordinate can have; 5.8e-10 + 2e-9 of a smaller one.
sn = fixed<-30,ne>(RAW);
m = fixed<-32,ne>(a);
wave = fixed<-30,ne>(m * sn);

{ a in [-0.5,0.5] /\ sn in [-1,1] /\ sn - S in [-2e-9,2e-9] -> wave - a * S in [-1.6e-9,1.6e-9] }

wave - a * S -> (wave - m * sn) + (m - a) * sn + a * (sn - S);
