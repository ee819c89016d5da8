# rotate() of linear.h: one row of a rotation (Q30, its elements rounded) times a vector (Q27 m).
# Bound: 10 nm at 4 m from the joint's axis for each coordinate and joint.
r1 = fixed<-30,ne>(R1);
r2 = fixed<-30,ne>(R2);
r3 = fixed<-30,ne>(R3);
v1 = fixed<-27,ne>(V1);
v2 = fixed<-27,ne>(V2);
v3 = fixed<-27,ne>(V3);
row = fixed<-27,ne>(r1 * v1 + r2 * v2 + r3 * v3);
Row = R1 * v1 + R2 * v2 + R3 * v3;

{ R1 in [-1,1] /\ R2 in [-1,1] /\ R3 in [-1,1] /\ v1 in [-4,4] /\ v2 in [-4,4] /\ v3 in [-4,4]
  -> row - Row in [-1e-8,1e-8] }

row - Row -> (row - (r1 * v1 + r2 * v2 + r3 * v3)) + ((r1 - R1) * v1 + (r2 - R2) * v2 + (r3 - R3) * v3);
