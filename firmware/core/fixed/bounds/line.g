# interpolate_line() of grid.cc: a 1-D table between two nodes, in units of its 16-bit values.
# p: where the value truly lies within the cell. The place w is Q20: rounded down, from a reciprocal of
# the step that is rounded to nearest and multiplied by at most 2^32.
# Bound: 0.095 of a unit for the steepest cell there can be, beside the half unit that a node is rounded by
# (`armtrue tables info` prints that one in um at the tool).
v0 = fixed<0,ne>(V0);
v1 = fixed<0,ne>(V1);
step = v1 - v0;
q = p + e;
w = fixed<-20,dn>(q);
t = step * w;
f = fixed<-12,ne>(t);
line = v0 + f;
Line = v0 + step * p;

{ v0 in [-32768,32767] /\ v1 in [-32768,32767] /\ p in [0,1] /\ e in [-1b-21,1b-21]
  -> line - Line in [-0.095,0.095] }

line - Line -> (f - t) + step * (w - p);
w - p -> (w - q) + e;
