g21 g90 g17
g0 x10. y0. z5.
g3 x0. y10. i-10. j0. f100
g1 x5.
z1.
m2
